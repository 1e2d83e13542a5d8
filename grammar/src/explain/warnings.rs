//! Pages of `W07..`: what compiles and should be looked at.

use super::{Example, Page};

pub(super) const UNIT_UNKNOWN: Page = Page {
    meaning:
        "A name without a unit stands in an equation in which others have units, so that the equation is not checked.
Each name is told once, with the number of equations.",
    broken: Example::Text(
        "model decay {
  state x [m] = 1;
  param k = 0.5;
  der(x) = -k*x;
  output y [m] = x;
}",
    ),
    corrected: "model decay {
  state x [m] = 1;
  param k = 0.5 [1/s];
  der(x) = -k*x;
  output y [m] = x;
}",
    why: "a model without units is a model; one with some of them is meant to be checked. `[1]` is a pure number.",
};

pub(super) const UNUSED: Page = Page {
    meaning: "Nothing uses what is declared here, or a prior is given of something that is not estimated.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k = 0.5;
  const g = 9.81;
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 0.5;
  der(x) = -k*x;
  output y = x;
}",
    why: "it is often the sign of a term that was forgotten, or of a name that was misspelt elsewhere.",
};

pub(super) const NO_INFLUENCE: Page = Page {
    meaning: "A parameter is used, but no output depends on it, so that no record can determine it.",
    broken: Example::Text(
        "model ship {
  state v = 1, x = 0;
  param k = 0.5, drift = 0.1;
  der(v) = -k*v;
  der(x) = v + drift;
  output v_m = v;
}",
    ),
    corrected: "model ship {
  state v = 1, x = 0;
  param k = 0.5, drift = 0.1;
  der(v) = -k*v;
  der(x) = v + drift;
  output v_m = v, x_m = x;
}",
    why: "an estimation leaves it where it is. Measure what it moves, or declare it `fixed`.",
};

pub(super) const OWN_RECORD: Page = Page {
    meaning: "An output contains `measured(...)` of itself at the same time, so that a record is compared with itself.",
    broken: Example::Text(
        "model tank {
  state h = 1;
  param k = 0.1;
  der(h) = -k*h;
  output level = 0.5*h + 0.5*measured(level);
}",
    ),
    corrected: "model tank {
  state h = 1;
  param k = 0.1;
  der(h) = -k*h;
  output level = h;
}",
    why: "a part of the difference is zero whatever the parameters are, and the fit looks better than it is.",
};
