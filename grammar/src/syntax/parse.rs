//! stub
use super::SyntaxTree;
use crate::{Diagnostic, Source};
/// stub
pub fn parse(_source: &Source) -> Result<SyntaxTree, Vec<Diagnostic>> {
    Err(Vec::new())
}
