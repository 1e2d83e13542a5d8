//! A mistake in what another macro put together.

macro_rules! gain {
    ($gain:expr) => {
        fdm::model! {
            model amplifier {
                input u;
                output y = $gain*u*missing;
            }
        }
    };
}

fn main() {
    let _model = gain!(1 + wrong);
}
