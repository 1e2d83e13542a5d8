//! Models in an editor: mistakes as one types, what a name is, where it stands, what can be typed, the layout.
//!
//! **In** messages of the Language Server Protocol with the texts of open files. **Out** answers and notices. **Never** runs a
//! model, never reads a file but those that a model uses, and never ends because a text is broken. **Start** at [`serve`] in `server.rs`: a text is
//! a `Document`; everything else answers one kind of question about it.

mod completion;
mod document;
mod findings;
mod hover;
mod names;
mod outline;
mod place;
mod server;
#[cfg(test)]
mod tests;

pub use server::{ServerError, serve, serve_standard_streams};
