//! stub
use crate::{Diagnostic, Model, syntax::SyntaxTree};
/// stub
pub fn check(_tree: &SyntaxTree) -> Result<(Model, Vec<Diagnostic>), Vec<Diagnostic>> {
    Err(Vec::new())
}
