//! Pages about models of several files, and of vectors and matrices.

use super::{Example, Page};

/// The file that examples use.
#[cfg(test)]
pub(super) const ACTUATOR: &str = "model actuator {
  input x;
  state z;
  param T = 0.1;
  der(z) = (x - z)/T;
  output y = z;
}";

pub(super) const NO_FILE: Page = Page {
    meaning: "The file that `use` names is not there, is no text, or is more than a model may use. Its path begins at the folder
of the file that says `use` (in `model!`, at the folder of Cargo.toml).",
    broken: Example::Text(
        "model elevator {
  input stick;
  use \"actuater.fdm\" as act(x = stick);
  output y = act.y;
}",
    ),
    corrected: "model elevator {
  input stick;
  use \"actuator.fdm\" as act(x = stick);
  output y = act.y;
}",
    why: "a part that is missing cannot be guessed; nothing else is told about the names that it would have.",
};

pub(super) const NOT_CONNECTED: Page = Page {
    meaning: "A submodel has an input, and the `use` does not say what drives it. (The file `actuator.fdm` says `input x;`.)",
    broken: Example::Text(
        "model elevator {
  input stick;
  use \"actuator.fdm\" as act(T = 0.2);
  output y = act.y + stick;
}",
    ),
    corrected: "model elevator {
  input stick;
  use \"actuator.fdm\" as act(x = stick, T = 0.2);
  output y = act.y + stick;
}",
    why: "inputs of the whole are recorded; those of a part are expressions of the whole, which only its author knows.",
};

pub(super) const WRONG_SHAPE: Page = Page {
    meaning: "Vectors or matrices are added, multiplied or equated whose sizes do not allow it, or one stands where a number is
needed. The message names both shapes: `[3]` is a vector, `[2, 3]` a matrix of 2 rows.",
    broken: Example::Text(
        "model roll {
  input u;
  state x[2];
  param A[2, 2] = [[-1, 2], [0, -3]], b[3] = 1;
  der(x) = A*x + b*u;
  output y[2] = x;
}",
    ),
    corrected: "model roll {
  input u;
  state x[2];
  param A[2, 2] = [[-1, 2], [0, -3]], b[2] = 1;
  der(x) = A*x + b*u;
  output y[2] = x;
}",
    why: "a size that is stretched or cut without a word is a model that nobody wrote.",
};

pub(super) const OUTSIDE_SHAPE: Page = Page {
    meaning: "An index is not there: indices count from 1, both ends belong to a range, and `A[1, 2]` is row 1, column 2.",
    broken: Example::Text(
        "model decay {
  state x[2] = 1;
  param k = 0.5;
  der(x) = -k*x;
  output y = x[0] + x[2];
}",
    ),
    corrected: "model decay {
  state x[2] = 1;
  param k = 0.5;
  der(x) = -k*x;
  output y = x[1] + x[2];
}",
    why: "there is no element to take the value from.",
};
