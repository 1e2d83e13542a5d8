//! Pages of `E08..`: submodels, vectors and matrices.

use super::{Example, Page};

/// The file that examples with submodels use.
pub(super) const LAG_FILE: (&str, &str) = (
    "lag.fdm",
    "model lag {
  input x;
  state y;
  param T = 0.5 in [0.01, 5];
  der(y) = (x - y)/T;
  output out = y;
}",
);

pub(super) const NO_FILE: Page = Page {
    meaning: "The file of a submodel is not there, or cannot be read. The message says where it was looked for.",
    broken: Example::Text(
        "model motor {
  input u;
  use \"leg.fdm\" as act(x = u);
  output y = act.out;
}",
    ),
    corrected: "model motor {
  input u;
  use \"lag.fdm\" as act(x = u);
  output y = act.out;
}",
    why: "paths are relative to the file that says `use`, so that a folder of models can be moved as a whole.",
};

pub(super) const NOT_CONNECTED: Page = Page {
    meaning: "A submodel is used, and one of its inputs has nothing connected to it.",
    broken: Example::Text(
        "model motor {
  input u;
  use \"lag.fdm\" as act;
  output y = act.out + u;
}",
    ),
    corrected: "model motor {
  input u;
  use \"lag.fdm\" as act(x = u);
  output y = act.out;
}",
    why: "an input of a submodel is no recorded channel of the whole; what drives it stands in the brackets. Params that are
not connected are params of the whole (`act.T`).",
};

pub(super) const WRONG_SHAPE: Page = Page {
    meaning: "Vectors or matrices meet whose shapes do not fit: in a sum, a product, an equation or the value of a declaration.",
    broken: Example::Text(
        "model pair {
  state x[2] = [1, 0];
  param A[2, 2] = [[a, 1], [0, b]], a = -1, b = -2;
  der(x) = A*[1, 2, 3];
  output y[2] = x;
}",
    ),
    corrected: "model pair {
  state x[2] = [1, 0];
  param A[2, 2] = [[a, 1], [0, b]], a = -1, b = -2;
  der(x) = A*x;
  output y[2] = x;
}",
    why: "a sum needs equal shapes, a product as many columns on the left as rows on the right. A number is of every shape.",
};

pub(super) const OUTSIDE_SHAPE: Page = Page {
    meaning: "An index is larger than the vector or matrix, or zero, or there are more indices than dimensions.",
    broken: Example::Text(
        "model pair {
  state x[2] = [1, 0];
  param a = -1;
  der(x) = a*x;
  output y = x[3];
}",
    ),
    corrected: "model pair {
  state x[2] = [1, 0];
  param a = -1;
  der(x) = a*x;
  output y[2] = x;
}",
    why: "elements are counted from 1, as in mathematics; a whole vector is its name without brackets.",
};
