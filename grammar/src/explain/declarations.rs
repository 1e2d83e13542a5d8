//! Pages of `E03..`: declarations.

use super::{Example, Page};

pub(super) const MISSING_VALUE: Page = Page {
    meaning: "A const, a let, a param or an output is declared without the value that makes it one.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 0.5 in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    why: "an estimation begins at the values in the text; no number is good enough to be guessed for all models.",
};

pub(super) const NEEDLESS_VALUE: Page = Page {
    meaning: "A value is given to something that has none, or a number stands where it cannot be that number (a
standard deviation that is not above zero).",
    broken: Example::Text(
        "model heating {
  input u = 1;
  state T = 20;
  der(T) = u - 0.1*T;
  output T_m = T;
}",
    ),
    corrected: "model heating {
  input u;
  state T = 20;
  der(T) = u - 0.1*T;
  output T_m = T;
}",
    why: "an input is what was recorded. A value in the text would be ignored, and nobody would know.",
};

pub(super) const BAD_BOUNDS: Page = Page {
    meaning: "Bounds are empty or reversed, or are made of something that is not a number.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k = 0.5 in [5, 0];
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 0.5 in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    why: "bounds are written `in [lower, upper]`; `inf` leaves a side open. No value fits between reversed ones.",
};

pub(super) const OUTSIDE_BOUNDS: Page = Page {
    meaning: "The start value of a parameter does not lie within the bounds that are given for it.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k = 7 in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 2 in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    why: "one of the two numbers is wrong, and only you know which.",
};

pub(super) const NOT_CONSTANT: Page = Page {
    meaning:
        "A value that is fixed during a run (a const, a param, a start value, a bound, a delay) depends on time, on a
state or on an input.",
    broken: Example::Text(
        "model decay {
  input u;
  state x = 1;
  param k = 2*u;
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  input u;
  state x = 1;
  let k = 2*u;
  der(x) = -k*x;
  output y = x;
}",
    why: "parameters are estimated once for a run. What changes within it is a `let`.",
};

pub(super) const WRONG_ATTRIBUTE: Page = Page {
    meaning: "`in [...]`, `fixed`, `per run`, `per group` or `wrap` stands with something that has no such attribute.",
    broken: Example::Text(
        "model decay {
  state x = 1 in [0, 5];
  param k = 0.5;
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = x0;
  param k = 0.5, x0 = 1 in [0, 5];
  der(x) = -k*x;
  output y = x;
}",
    why: "bounds hold numbers that are estimated; states follow from the equations and cannot be held.",
};
