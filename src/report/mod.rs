//! What people read: findings about models as text, with the lines they are about.
//!
//! **In** finished values: a [`fdm_grammar::Source`] and what was found in it. **Out** text.
//! **Never** computes, and never prints: the command line does. **Start** at [`render`].

mod diagnostic;

pub use diagnostic::render;
