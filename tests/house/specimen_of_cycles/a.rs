//! Imports `b` by a group.

use crate::{b::Beta, d};
