//! Mistakes of what is not there: an equation, outputs, the model itself.

fn main() {
    let _first = fdm::model! {
        model a {
            state x, y;
            der(x) = y;
        }
    };
    let _second = fdm::model! {};
}
