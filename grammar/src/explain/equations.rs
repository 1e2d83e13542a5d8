//! Pages of `E04..` and `E05..`: equations and kinds of values.

use super::{Example, Page};

pub(super) const MISSING_EQUATION: Page = Page {
    meaning: "A state is declared and no `der(...) = ...;` says how it changes.",
    broken: Example::Text(
        "model swing {
  state angle = 1, rate;
  der(angle) = rate;
  output y = angle;
}",
    ),
    corrected: "model swing {
  state angle = 1, rate;
  der(angle) = rate;
  der(rate) = -angle;
  output y = angle;
}",
    why: "a state without an equation could stand still or do anything; `der(x) = 0;` says that it stands still.",
};

pub(super) const TWO_EQUATIONS: Page = Page {
    meaning: "A state has two equations. Both places are shown.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  der(x) = -x;
  der(x) = -2*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  der(x) = -x - 2*x;
  output y = x;
}",
    why: "equations are not summed and not overwritten: one state, one equation.",
};

pub(super) const NOT_A_DERIVATIVE: Page = Page {
    meaning: "The left side of an equation is not `der(state)`.",
    broken: Example::Text(
        "model decay {
  input u;
  state x = 1;
  flow = 2*u;
  der(x) = 2*u - x;
  output y = x;
}",
    ),
    corrected: "model decay {
  input u;
  state x = 1;
  let flow = 2*u;
  der(x) = flow - x;
  output y = x;
}",
    why: "names for expressions are declared with `let`, measured quantities with `output`.",
};

pub(super) const NO_OUTPUT: Page = Page {
    meaning: "The model has no `output`, so that nothing in it can be compared with a record.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  param k = 0.5;
  der(x) = -k*x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  param k = 0.5;
  der(x) = -k*x;
  output x_m = x;
}",
    why: "parameters are found from the difference between outputs and the recorded columns of the same names.",
};

pub(super) const UNSUPPORTED: Page = Page {
    meaning: "The language describes this, and this version of the program does not compile it: the statement or form that is
named, or more of something than there is room for (4096 delayed signals).",
    broken: Example::Made { told: "twelve `let`s, each the sum of three delays of the one before it", make: echoes },
    corrected: "model echo {
  input u;
  state x = 1;
  param tau = 0.5 in [0, 2];
  let once = delay(u, tau) + delay(u, 2*tau) + delay(u, 3*tau);
  der(x) = once - x;
  output y = x;
}",
    why: "a model that is understood in part would give the numbers of another model, and no text may exhaust the memory of
who reads it.",
};

fn echoes() -> Vec<u8> {
    let mut text = String::from("model echo { input u; state x = 1; param tau = 0.5; let e0 = u;");
    for k in 0..12 {
        let term = |n: usize| format!("delay(e{k}, {}*tau)", n * 3usize.pow(k));
        text += &format!("let e{} = {} + {} + {};", k + 1, term(1), term(2), term(3));
    }
    (text + "der(x) = e12 - x; output y = x; }").into_bytes()
}

pub(super) const BAD_DELAY: Page = Page {
    meaning: "A delay is negative, or depends on something that changes during the run.",
    broken: Example::Text(
        "model late {
  input u;
  state x = 1;
  der(x) = delay(u, -0.5) - x;
  output y = x;
}",
    ),
    corrected: "model late {
  input u;
  state x = 1;
  param tau = 0.5 in [0, 2];
  der(x) = delay(u, tau) - x;
  output y = x;
}",
    why: "the future of a signal is not known. (A record that was written late is another matter: a parameter that
delays inputs only may be negative where its bounds say so.)",
};

pub(super) const NOT_FINITE: Page = Page {
    meaning: "A value that can be computed before any data are read is infinite or not a number.",
    broken: Example::Text(
        "model decay {
  state x = 1;
  const half = 0;
  const k = 2/half;
  der(x) = -k*x;
  output y = x;
}",
    ),
    corrected: "model decay {
  state x = 1;
  const half = 0.5;
  const k = 2/half;
  der(x) = -k*x;
  output y = x;
}",
    why: "every response would be NaN. Look for a division by zero, an overflow, or a root or logarithm of something
negative.",
};

pub(super) const WANTED_CONDITION: Page = Page {
    meaning: "Between `if` and `then`, and beside `and`, `or`, `not`, stands a number where a condition is needed.",
    broken: Example::Text(
        "model valve {
  input u;
  state h = 1;
  der(h) = if u then 1 else -h;
  output y = h;
}",
    ),
    corrected: "model valve {
  input u;
  state h = 1;
  der(h) = if u > 0.5 then 1 else -h;
  output y = h;
}",
    why: "whether 0.3 is true is a matter of taste in other languages; here the limit is written.",
};

pub(super) const WANTED_NUMBER: Page = Page {
    meaning: "A comparison stands where a number is needed.",
    broken: Example::Text(
        "model valve {
  input u;
  state h = 1;
  der(h) = 2*(u > 0.5) - h;
  output y = h;
}",
    ),
    corrected: "model valve {
  input u;
  state h = 1;
  der(h) = (if u > 0.5 then 2 else 0) - h;
  output y = h;
}",
    why: "a choice says what both cases are, and is differentiated case by case.",
};

pub(super) const SINGULAR_RATES: Page = Page {
    meaning: "Several equations hold the derivatives of several states, and do not determine them: one of the equations says
what the others say, or a derivative stands in none that is left for it.",
    broken: Example::Text(
        "model pair {
  state p = 1, q = 0;
  param a = 0.5;
  der(p) + der(q) = -a*p;
  2*der(p) + 2*der(q) = -a*q;
  output p_m = p, q_m = q;
}",
    ),
    corrected: "model pair {
  state p = 1, q = 0;
  param a = 0.5;
  der(p) + der(q) = -a*p;
  der(p) - der(q) = -a*q;
  output p_m = p, q_m = q;
}",
    why: "equations with several derivatives are solved for them symbolically, once; that needs as many independent equations as
derivatives.",
};

pub(super) const NONLINEAR_RATE: Page = Page {
    meaning: "A derivative stands inside a function, a power, a choice or a product with another derivative, so that the equation
cannot be solved for it.",
    broken: Example::Text(
        "model fall {
  state v = 0;
  param g = 9.81;
  der(v)^2 = g^2;
  output v_m = v;
}",
    ),
    corrected: "model fall {
  state v = 0;
  param g = 9.81;
  der(v) = g;
  output v_m = v;
}",
    why: "a nonlinear equation may have several solutions or none; which of them is meant only its author can say.",
};
