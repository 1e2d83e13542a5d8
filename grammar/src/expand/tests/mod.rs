//! What models mean that say more than the core language.

mod arrays;
mod submodels;
mod written_out;
