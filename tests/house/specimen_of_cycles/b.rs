//! Imports `room/c` by a name that the room hands on.

use super::room::Gamma;
