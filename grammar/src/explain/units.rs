//! Pages of `E06..`: units.

use super::{Example, Page};

pub(super) const UNKNOWN_UNIT: Page = Page {
    meaning: "A symbol between brackets is not a unit, with or without a prefix. The message proposes the nearest one.",
    broken: Example::Text(
        "model fall {
  state v [metre/s];
  const g = 9.81 [m/s^2];
  der(v) = -g;
  output v_m [m/s] = v;
}",
    ),
    corrected: "model fall {
  state v [m/s];
  const g = 9.81 [m/s^2];
  der(v) = -g;
  output v_m [m/s] = v;
}",
    why: "units are compared and columns of data are converted, so that a unit must have a size.",
};

pub(super) const UNIT_MISMATCH: Page = Page {
    meaning: "Quantities of different units are added, compared or equated. If they measure the same and only differ in
size, the message names the factor.",
    broken: Example::Text(
        "model climb {
  state h [m], v [ft/s] = 3;
  der(h) = v;
  der(v) = 0;
  output h_m [m] = h;
}",
    ),
    corrected: "model climb {
  state h [m], v [ft/s] = 3;
  const metres = 0.3048 [m/ft];
  der(h) = metres*v;
  der(v) = 0;
  output h_m [m] = h;
}",
    why: "numbers keep the unit in which you write them; nothing is converted behind your back. The rate of a state has
its unit divided by that of time.",
};

pub(super) const UNIT_ARGUMENT: Page = Page {
    meaning: "A function is applied to a quantity of a unit that it has no value for: `sin` of degrees, `exp` of a
length.",
    broken: Example::Text(
        "model pendulum {
  state angle [deg] = 10, rate [deg/s];
  const k = 9.81 [deg/s^2];
  der(angle) = rate;
  der(rate) = -k*sin(angle);
  output y [deg] = angle;
}",
    ),
    corrected: "model pendulum {
  state angle [deg] = 10, rate [deg/s];
  const k = 9.81 [deg/s^2];
  der(angle) = rate;
  der(rate) = -k*sin(deg2rad(angle));
  output y [deg] = angle;
}",
    why: "the sine of 10 is -0.54 when it means radians and 0.17 when it means degrees.",
};

pub(super) const UNIT_EXPONENT: Page = Page {
    meaning: "An exponent has a unit, or it can vary while its base has a unit.",
    broken: Example::Text(
        "model drag {
  state v [m/s] = 10;
  param n = 2, k = 0.1 [1/m];
  der(v) = -k*v^n;
  output v_m [m/s] = v;
}",
    ),
    corrected: "model drag {
  state v [m/s] = 10;
  param n = 2 [1], k = 0.1 [m/s^2];
  const v0 = 1 [m/s];
  der(v) = -k*(v/v0)^n;
  output v_m [m/s] = v;
}",
    why: "the unit of the power would change with the parameter. Divide the base by a reference of its own unit.",
};
