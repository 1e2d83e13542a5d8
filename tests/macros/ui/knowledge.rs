//! Records and priors of the wrong things, each at its tokens.

fn main() {
    let _tank = fdm::model! {
        model tank {
            state h = 1;
            param k = 0.1;
            der(h) = -k*measured(k);
            output level = 2*h;
            prior k ~ gauss(0.1, 0.05);
            noise h = 0.2;
        }
    };
}
