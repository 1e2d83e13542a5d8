//! A sum over several lines whose units do not fit.

fn main() {
    let _model = fdm::model! {
        model a {
            state x "place" [m], v "speed" [m/s];
            der(x) = v
                + x;
            der(v) = 0 [m/s^2];
            output y [m] = x;
        }
    };
}
