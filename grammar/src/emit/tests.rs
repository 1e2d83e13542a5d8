//! What can be seen of generated text without a compiler; `tests/generated_code.rs` compiles it and compares bits.

use super::identifier::{c_string, comment, distinct, plain};
use super::notation::CNotation;
use super::pieces::Pieces;
use super::*;
use crate::op::{Op, ROWS};
use crate::schedule::{Instruction, Operand, Placed, Program};
use crate::{Source, compile};
