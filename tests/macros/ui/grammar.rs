//! Text that does not fit the grammar, and what follows is read nevertheless.

fn main() {
    let _model = fdm::model! {
        model a {
            state x [m] = ;
            der(x) = (1 + ) * 2;
            output y = x +* 3;
        }
    };
}
