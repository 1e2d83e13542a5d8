//! Pages of tables and blocks.

use super::{Example, Page};

pub(super) const BAD_TABLE: Page = Page {
    meaning: "A table has fewer than two points, its abscissae do not increase from point to point, or its values do not stand at every \
              crossing of its axes.",
    broken: Example::Text(
        "model wing {
  input alpha;
  param CL0 = 0.2;
  table CL(x) = linear { -0.2: -0.9, 0: CL0, 0: 0.3, 0.3: 1.6 };
  output lift = CL(alpha);
}",
    ),
    corrected: "model wing {
  input alpha;
  param CL0 = 0.2;
  table CL(x) = linear { -0.2: -0.9, 0: CL0, 0.3: 1.6 };
  output lift = CL(alpha);
}",
    why: "a table has one value at each abscissa; a jump has no derivative, and is written as two points close to each other.",
};

pub(super) const BAD_BLOCK: Page = Page {
    meaning: "A block (`lag`, `washout`, `tf` ...) cannot be built of states: a time constant is not above 0, the numerator of a \
              transfer function has a higher degree than its denominator, or its leading coefficient is 0.",
    broken: Example::Text(
        "model actuator {
  input command;
  param T = 0 in [0, 1];
  output angle = lag(command, T);
}",
    ),
    corrected: "model actuator {
  input command;
  param T = 0.05 in [0.001, 1];
  output angle = lag(command, T);
}",
    why: "the state of a lag changes by `(x - state)/T`. A lag without delay is its input itself, and what differentiates its input \
          has no state at all.",
};

pub(super) const BAD_REACTION: Page = Page {
    meaning: "Reactions make matter from nothing: no masses above zero are kept by all of them. Or a reaction cannot be read as a balance: one rate with \
              `<->`, a species in two volumes.",
    broken: Example::Text(
        "model growth {
  state A = 1, B;
  param k1 = 1, k2 = 0.1;
  reactions { A -> B : k1*A; A -> 2*B : k2*A; }
  output y = B;
}",
    ),
    corrected: "model growth {
  state A = 1, B;
  param k1 = 1, k2 = 0.1;
  reactions { A -> B : k1*A; 0 + A -> 2*B : k2*A; }
  output y = B;
}",
    why: "a number that is wrong by one gives a fit that looks good and rates that mean nothing; `0` says that something takes part which is not modelled.",
};
