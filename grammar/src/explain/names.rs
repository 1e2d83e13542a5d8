//! Pages of `E02..`: names.

use super::{Example, Page};

pub(super) const UNKNOWN_NAME: Page = Page {
    meaning: "An expression mentions a name that no statement declares. The message proposes the nearest declared name.",
    broken: Example::Text(
        "model roll {
  state rate = 1;
  param damping = 0.2;
  der(rate) = -dampng*rate;
  output p = rate;
}",
    ),
    corrected: "model roll {
  state rate = 1;
  param damping = 0.2;
  der(rate) = -damping*rate;
  output p = rate;
}",
    why: "a name that is not declared is nearly always misspelt; inventing a variable for it would hide that.",
};

pub(super) const DECLARED_TWICE: Page = Page {
    meaning: "Two statements declare the same name, or give the same thing twice. Both places are shown.",
    broken: Example::Text(
        "model roll {
  state p = 1;
  param d = 0.2;
  param d = 0.3;
  der(p) = -d*p;
  output p_m = p;
}",
    ),
    corrected: "model roll {
  state p = 1;
  param d = 0.2, d2 = 0.3;
  der(p) = -d*p - d2*p*abs(p);
  output p_m = p;
}",
    why: "statements may stand in any order, so that there is no first and no last one that could win.",
};

pub(super) const RESERVED_NAME: Page = Page {
    meaning: "The name belongs to the language: a word of its grammar, a function, `t` (the time) or `pi`.",
    broken: Example::Text(
        "model roll {
  state exp = 1;
  der(exp) = -exp;
  output y = exp;
}",
    ),
    corrected: "model roll {
  state expansion = 1;
  der(expansion) = -expansion;
  output y = expansion;
}",
    why: "who reads `exp` should not have to look whether it is the exponential here.",
};

pub(super) const UNKNOWN_FUNCTION: Page = Page {
    meaning: "Something is called that is not a function of the language. The message proposes the nearest one; the
list stands in the language reference under Expressions.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k = 0.3;
  der(x) = -k*ln(1 + x);
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 0.3;
  der(x) = -k*log(1 + x);
  output y = x;
}",
    why: "every function has an exact derivative and the same bits on every machine, so that there is a list of them.",
};

pub(super) const ARGUMENT_COUNT: Page = Page {
    meaning: "A function is called with more or fewer arguments than it has.",
    broken: Example::Text(
        "model swing {
  state angle = 1;
  der(angle) = -clip(angle, 1);
  output y = angle;
}",
    ),
    corrected: "model swing {
  state angle = 1;
  der(angle) = -clip(angle, -1, 1);
  output y = angle;
}",
    why: "there are no default arguments: what is not written would have to be guessed.",
};

pub(super) const CYCLE: Page = Page {
    meaning:
        "Definitions need each other in a circle, so that none can be computed first (an algebraic loop). The circle
is written out.",
    broken: Example::Text(
        "model loop {
  state x = 1;
  let force = -2*speed;
  let speed = x + force;
  der(x) = speed;
  output y = x;
}",
    ),
    corrected: "model loop {
  state x = 1;
  let speed = x/3;
  der(x) = speed;
  output y = x;
}",
    why: "a `let` is a name for an expression, not an equation to be solved. Solve the circle by hand, or break it with
a state: real loops have something in them that takes time.",
};

pub(super) const WRONG_NAME: Page = Page {
    meaning: "The name is declared, but as another kind of thing than is needed at this place.",
    broken: Example::Text(
        "model tank {
  state h = 1;
  param k = 0.1;
  der(h) = -k*h;
  output h_m = h;
  noise h = 0.02;
}",
    ),
    corrected: "model tank {
  state h = 1;
  param k = 0.1;
  der(h) = -k*h;
  output h_m = h;
  noise h_m = 0.02;
}",
    why: "noise is known of outputs, priors of parameters and initial values, `der` of states: anything else has no
meaning that could be computed.",
};
