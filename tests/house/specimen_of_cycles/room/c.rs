//! Imports `a` by a name that the root hands on.

use crate::Alpha;
