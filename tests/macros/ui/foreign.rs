//! Literals that only Rust has.

fn main() {
    let _model = fdm::model! {
        model a r#"with "quotes""# {
            param k = b'x', c = 'y';
            output y = k*c;
        }
    };
}
