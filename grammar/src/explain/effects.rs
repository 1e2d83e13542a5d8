//! Pages of `E09..`: effects.

use super::{Example, Page};

pub(super) const NULL_MISSING: Page = Page {
    meaning: "A param of an effect has no null value, the one at which the effect vanishes, or a nuisance has nothing that a \
search could try.",
    broken: Example::Text(
        "effect drag(x: state) \"quadratic damping of {x}\" {
  param c;
  add der(x) += c*x*abs(x);
}",
    ),
    corrected: "effect drag(x: state) \"quadratic damping of {x}\" {
  param c = 0;
  add der(x) += c*x*abs(x);
}",
    why: "whether an effect is there is asked by comparing the model with it and the model without it, which is the one at the null.",
};

pub(super) const NOT_VANISHING: Page = Page {
    meaning: "At its null values the effect leaves something other than the model that it was applied to. The message names \
a place and both values there.",
    broken: Example::Text(
        "effect scale(i: input) \"scale of {i}\" {
  param k = 0;
  replace i with k*i;
}",
    ),
    corrected: "effect scale(i: input) \"scale of {i}\" {
  param k = 0;
  replace i with (1 + k)*i;
}",
    why: "an effect that does not vanish would be found in every record, because it changes the model whatever its size is.",
};

pub(super) const NO_REWRITE: Page = Page {
    meaning: "No line of the effect changes the model, a param stands in none of them, or two lines change the same thing.",
    broken: Example::Text(
        "effect push(x: state) \"a push on {x}\" {
  param c = 0;
  let force = c*x;
}",
    ),
    corrected: "effect push(x: state) \"a push on {x}\" {
  param c = 0;
  let force = c*x;
  add der(x) += force;
}",
    why: "what changes nothing can be of any size, and of two changes of one thing the order would decide.",
};

pub(super) const MISFIT: Page = Page {
    meaning: "The effect is well formed, and still no model comes of it: bounds without room, a unit that does not fit, an \
expression that the model cannot have in this place.",
    broken: Example::Text(
        "effect late(i: input) \"{i} is late\" {
  param tau = 0 in [1, 0];
  replace i with delay(i, tau);
}",
    ),
    corrected: "effect late(i: input) \"{i} is late\" {
  param tau = 0 in [0, 1];
  replace i with delay(i, tau);
}",
    why: "every effect is tried on a plain model when it is read, so that a search does not stop at it later.",
};
