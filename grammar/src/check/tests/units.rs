//! Units: each disagreement with its place, sentence and hint; and what is no disagreement.

use super::told;

/// Findings about statements on line 2 of a model that is otherwise complete.
fn same(table: &[(&str, &[&str])]) {
    for (statements, want) in table {
        let text = format!(
            "model m {{ state x [m]; input u [V], h [ft], e [deg], q [1/s], v [m/s], r [rad/s]; param b = 1 [1]; \
             der(x) = v; output y = x*u*h*e*q*v*r*b;\n{statements}\n}}"
        );
        assert_eq!(told(&text), *want, "{statements}");
    }
}

#[test]
fn sums_comparisons_and_branches() {
    same(&[
        (
            "output w = x + h;",
            &[
                "2:14 E0602 m and ft are added without conversion; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        ("output w = x + q;", &["2:14 E0602 m and 1/s cannot be added; a factor in m*s lies between them"]),
        (
            "output w = if x < h then 1 else 0;",
            &[
                "2:17 E0602 m and ft are compared without conversion; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "output w = max(x, x, h);",
            &[
                "2:22 E0602 the arguments of `max` are in m and in ft; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "output w = if b > 0 then x else h;",
            &[
                "2:33 E0602 the branches of `if` are in m and in ft; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "output w = atan2(x, h);",
            &[
                "2:21 E0602 the arguments of `atan2` are in m and in ft; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "output w = x*(2*pi) + h*3;",
            &[
                "2:21 E0602 m and ft are added without conversion; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
    ]);
}

#[test]
fn functions_and_exponents() {
    same(&[
        (
            "output w = sin(e);",
            &["2:16 E0603 `sin` needs an angle in rad, this is in deg; `sin(deg2rad(...))` converts it"],
        ),
        (
            "output w = sin(x);",
            &["2:16 E0603 `sin` needs an angle in rad, this is in m; divide by a reference quantity in m"],
        ),
        (
            "output w = log(q);",
            &["2:16 E0603 `log` needs a pure number, this is in 1/s; divide by a reference quantity in 1/s"],
        ),
        (
            "output w = sin(deg2rad(e)) + cos(rad2deg(e));",
            &[
                "2:42 E0603 `rad2deg` converts angles in rad, this is in deg; use it for quantities in rad, rad/s and the like",
            ],
        ),
        (
            "output w = deg2rad(x);",
            &[
                "2:20 E0603 `deg2rad` converts angles in deg, this is in m; use it for quantities in deg, deg/s and the like",
            ],
        ),
        (
            "output w = sqrt(x);",
            &[
                "2:17 E0603 the square root of a quantity in m has no unit; only even powers, such as m^2/s^2, have a square root",
            ],
        ),
        (
            "output w = x^0.5;",
            &[
                "2:14 E0604 a quantity in m to the power 0.5 has no unit; divide the base by a reference quantity, as in `(x/x0)^n`",
            ],
        ),
        (
            "output w = x^b;",
            &[
                "2:14 E0604 a quantity in m has a constant exponent, this one can vary; divide the base by a reference quantity, as in `(x/x0)^n`",
            ],
        ),
        (
            "output w = b^x;",
            &["2:14 E0604 an exponent is a pure number, this is in m; divide it by a reference quantity in m"],
        ),
        (
            "output w = x^q;",
            &["2:14 E0604 an exponent is a pure number, this is in 1/s; divide it by a reference quantity in 1/s"],
        ),
        ("output w = x^100*x^100;", &["2:12 E0604 the exponents of the unit of this expression are too large"]),
        (
            "output w = sin(2*t);",
            &["2:16 E0603 `sin` needs an angle in rad, this is in s; give the number its unit: `const w = 2 [rad/s];`"],
        ),
    ]);
}

#[test]
fn declared_units() {
    same(&[
        (
            "output w [ft] = x;",
            &[
                "2:17 E0602 `w` is declared in ft, its value is in m; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 3.280839895013123 [ft/m];`",
            ],
        ),
        (
            "let z [s] = q*x; output w = z;",
            &["2:13 E0602 `z` is declared in s, its value is in m/s; a factor in s^2/m lies between them"],
        ),
        (
            "param p = 1 [s] in [0, k]; const k = 2 [min]; output w = delay(u, p);",
            &[
                "2:24 E0602 `p` is declared in s, this bound is in min; they differ by the factor 60 (1 min is 60 s); convert with a constant, `const c = 60 [s/min];`",
            ],
        ),
        ("param zz = 1 [foot]; output w = zz;", &["2:15 E0601 `foot` is not a known unit; did you mean `ft`?"]),
    ]);
}

#[test]
fn time() {
    same(&[
        (
            "output w = delay(u, k); const k = 1 [min];",
            &[
                "2:21 E0602 a delay is a time in s, this is in min; they differ by the factor 60 (1 min is 60 s); convert with a constant, `const c = 60 [s/min];`",
            ],
        ),
        (
            "state z [m]; der(z) = x; output w = z;",
            &["2:23 E0602 `der(z)` is in m/s, the right side in m; a factor in 1/s lies between them"],
        ),
        (
            "state z [m]; der(z) = q*h; output w = z;",
            &[
                "2:23 E0602 `der(z)` is in m/s, the right side in ft/s; they differ by the factor 3.28084 (1 m/s is 3.28084 ft/s); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "state z [deg]; der(z) = r; output w = z;",
            &[
                "2:25 E0602 `der(z)` is in deg/s, the right side in rad/s; they differ by the factor 57.2958 (1 rad/s is 57.2958 deg/s); `rad2deg(...)` converts rad/s to deg/s",
            ],
        ),
        (
            "state z [m] = k; param k = 1 [s]; der(z) = v; output w = z;",
            &["2:15 E0602 `z` is declared in m, its value is in s; a factor in m/s lies between them"],
        ),
        ("time [m];", &["2:6 E0602 `m` is not a unit of time; `time [s];` or `time [min];`"]),
        (
            "time [min]; state z [m]; der(z) = v; output w = z;",
            &[
                "1:109 E0602 `der(x)` is in m/min, the right side in m/s; they differ by the factor 60 (1 m/s is 60 m/min); convert with a constant, `const c = 60 [s/min];`",
                "2:35 E0602 `der(z)` is in m/min, the right side in m/s; they differ by the factor 60 (1 m/s is 60 m/min); convert with a constant, `const c = 60 [s/min];`",
            ],
        ),
    ]);
}

#[test]
fn nothing_to_tell() {
    same(&[
        ("output w = sqrt(x*x) + x;", &[]),
        ("output w = (x^2)^1.5 + x^3;", &[]),
        ("output w = b^b;", &[]),
        ("output w = n; param n = 2;", &[]),
        ("output w = x + 1;", &[]),
        ("let tc = tk + 1; input tk [degC]; output w [K] = tc;", &[]),
        ("const e2 [deg] = 5; output w [deg] = e2 + e;", &[]),
        ("output w = sin(omega*t); param omega = 1 [rad/s];", &[]),
        ("output w [1/s^2] = 0.5*q^2;", &[]),
        ("output w = exp(-t/tt); param tt = 5 [s];", &[]),
    ]);
}

#[test]
fn undeclared_units() {
    same(&[
        (
            "output w = x*n + x; param n = 2;",
            &[
                "2:27 W0701 `n` has no unit: the units of the output `w` cannot be checked; declare one, such as `[m/s]`, or `[1]` for a pure number",
            ],
        ),
        (
            "output w = sin(n)*x; param n = 1;",
            &[
                "2:28 W0701 `n` has no unit: the units of the output `w` cannot be checked; declare one, such as `[m/s]`, or `[1]` for a pure number",
            ],
        ),
    ]);
}

#[test]
fn a_model_without_units_is_not_bothered() {
    let text = "model m { state x; der(x) = sin(2*t) - a*x^a; param a = 1; output y = log(x); }";
    assert_eq!(told(text), Vec::<String>::new());
}

#[test]
fn the_example_of_the_language_page_needs_one_more_second() {
    let text = "model pitch_eqv {
  input  stick  [deg];
  state  q      [deg/s]  = q0;
  state  z      [deg/s^2];
  param  q0     = 0          [deg/s]   per run;
  param  omega  = 2.0 in [0.1, 20]  [rad/s];
  param  zeta   = 0.7 in [0, 2] [1];
  param  K      = 1.5        [1/s^2];
  param  tau    = 0.1 in [0, 0.5]  [s];
  let    damping = 2*zeta*omega;
  der(q) = z;
  der(z) = -damping*z - omega^2*q + K*stick;
  output q_m [deg/s] = delay(q, tau);
}";
    let want = "12:35 E0602 rad*deg/s^3 and deg/s^2 cannot be added; a factor in rad/s lies between them";
    assert_eq!(told(text), [want]);
    assert_eq!(told(&text.replace("[1/s^2];", "[1/s^3];")), Vec::<String>::new());
}

#[test]
fn records_priors_and_noise() {
    same(&[
        ("output d [m/s] = v; state z [m]; der(z) = measured(d) + v;", &[]),
        (
            "output d [m] = x; state z [m]; der(z) = measured(x) + v;",
            &["2:53 E0602 m and m/s cannot be added; a factor in s lies between them"],
        ),
        ("output d [m] = x; noise d = 0.1; prior b ~ normal(1, 0.1);", &[]),
        ("output d [m] = x; noise d = 0.1*abs(d) + 0.2 + b*x;", &[]),
        (
            "output d [m] = x; noise d = 0.1*h;",
            &[
                "2:29 E0602 `d` is declared in m, the noise of `d` is in ft; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "output d [m] = x; const s = 1 [ft]; noise d = s;",
            &[
                "2:47 E0602 `d` is declared in m, the noise of `d` is in ft; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 0.3048 [m/ft];`",
            ],
        ),
        (
            "const s = 1 [m]; prior b ~ normal(s, 2*s);",
            &[
                "2:35 E0602 `b` is declared in 1, the mean of the prior of `b` is in m; a factor in 1/m lies between them",
                "2:38 E0602 `b` is declared in 1, the deviation of the prior of `b` is in m; a factor in 1/m lies between them",
            ],
        ),
        (
            "state z [ft] = free; der(z) = 2*z*q; output d [ft] = z; const s = 1 [m]; prior z(0) ~ normal(0, s);",
            &[
                "2:97 E0602 `z` is declared in ft, the deviation of the prior of `z(0)` is in m; they differ by the factor 3.28084 (1 m is 3.28084 ft); convert with a constant, `const c = 3.280839895013123 [ft/m];`",
            ],
        ),
        // without a unit of its own the record is in that of the state
        ("output d = x, f [m] = measured(d) + x;", &[]),
        (
            "output d = 2*x, f [m] = measured(d) + x;",
            &[
                "2:8 W0701 `d` has no unit: the units of the output `f` cannot be checked; declare one, such as `[m/s]`, or `[1]` for a pure number",
            ],
        ),
    ]);
}
