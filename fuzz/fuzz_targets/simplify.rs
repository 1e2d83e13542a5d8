//! What an expression is worth after simplification is what its text says.
#![no_main]

use arbitrary::Unstructured;
use fdm_fuzz::{Expression, LEAVES};
use fdm_grammar::graph::Leaf;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let mut u = Unstructured::new(data);
    let mut value = |u: &mut Unstructured<'_>| -> arbitrary::Result<f64> {
        Ok(f64::from(u.int_in_range(-4000..=4000_i16)?) / 1000.0)
    };
    let made = (|| -> arbitrary::Result<_> {
        let mut leaves = [0.0; LEAVES.len()];
        for leaf in &mut leaves {
            *leaf = value(&mut u)?;
        }
        Ok((leaves, Expression::arbitrary(&mut u, 30)?))
    })();
    let Ok((leaves, expression)) = made else { return };
    let text = format!(
        "model m {{ state x1, x2; input u; param a = 1, b = 1; der(x1) = a*u; der(x2) = b; output y = {}; }}",
        expression.text()
    );
    let Some(compiled) = fdm_fuzz::compile(&text) else { return };
    let model = &compiled.model;
    let got = model.graph.evaluate(model.outputs[0].expr, |leaf| match leaf {
        Leaf::State(k) => leaves[k as usize],
        Leaf::Input(_) => leaves[2],
        Leaf::Param(k) => leaves[3 + k as usize],
        _ => leaves[5],
    });
    if !expression.is_finite(&leaves) {
        return;
    }
    // the sign of a zero has no meaning in the language: what hangs on it has no value to compare
    let [want, other] = [0.0, -0.0].map(|zero| expression.value(&leaves, zero, 0.0));
    if want.to_bits() != other.to_bits() && want != other {
        return;
    }
    // rewrites are exact in real numbers, not in the last bits; what is ill-conditioned shows by its neighbours
    let near: Vec<f64> = (0..LEAVES.len())
        .map(|k| {
            let mut moved = leaves;
            moved[k] = moved[k] * (1.0 + 1e-12) + 1e-14;
            expression.value(&moved, 0.0, 0.0)
        })
        .chain([1e-13, -1e-13].map(|rounding| expression.value(&leaves, 0.0, rounding)))
        .collect();
    let spread = near.iter().map(|v| (v - want).abs()).fold(0.0, |a: f64, b| if b.is_nan() { b } else { a.max(b) });
    let odd = !want.is_finite() || spread.is_nan() || spread > 1e-3 * want.abs().max(1.0);
    assert!(
        odd || (got - want).abs() <= 1e-6 * want.abs().max(1.0) + 100.0 * spread,
        "{text}\n{leaves:?}: {got}, not {want}"
    );
});
