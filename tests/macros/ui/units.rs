//! A sum over several lines whose units do not fit.

fn main() {
    let _model = fdm::model! {
        model a {
            state x "place" [m], v "speed" [m/s];
            der(x) = v
                + x;
            der(v) = -x;
            output y [m] = x;
        }
    };
}
