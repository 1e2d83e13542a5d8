//! An estimator in C beside the recursion of `fdm`, on a record that nobody flew.

#![allow(unsafe_code, reason = "what was compiled is loaded into this process")]

use super::VerifyError;
use super::compiled::{c_library, prefix_of};
use super::{Noise, Numbers};
use crate::fmu::Files;
use fdm_estimate::equation_error::{ParameterGroup, RecursiveConstants, RecursiveEstimator};
use fdm_system::Model;
use fdm_system::record::Run;
use std::path::Path;

/// All functions of a file behind one: which, what is read, what is written.
type Call = unsafe extern "C" fn(i32, *const f64, *mut f64) -> i32;
/// What a compiled estimator answers: the question, numbers that it is given, numbers that it fills.
type Ask<'a> = dyn Fn(i32, &[f64], &mut [f64]) -> i32 + 'a;

const CALL: &str = "fdm_verified_recursion";

const VALUES: &str = "estimates";
const ERRORS: &str = "standard errors";

/// The source, and a function that calls its functions.
pub(super) fn files(model: &Model, text: &str) -> Files {
    let p = prefix_of(model, text, "_ESTIMATOR_DECLARED");
    let calls = format!(
        "#include \"model.c\"
int {CALL}(int which, const double *in, double *out);
int {CALL}(int which, const double *in, double *out)
{{
    static {p}_estimator e;
    int k, g;
    switch (which) {{
    case 0:
        out[0] = {p}_EQUATIONS, out[1] = {p}_GROUPS, out[2] = {p}_UNKNOWNS, out[3] = {p}_SIGNALS, out[4] = {p}_INPUTS, out[5] = {p}_OUTPUTS;
        return 0;
    case 1:
        {p}_begin(&e);
        *out++ = e.forgetting;
        for (k = 0; k < {p}_EQUATIONS; k++) *out++ = e.weight[k];
        for (k = 0; k < {p}_SIGNALS; k++) *out++ = {p}_signal_held[k];
        for (g = 0; g < {p}_GROUPS; g++) {{ *out++ = {p}_group_first[g + 1] - {p}_group_first[g]; *out++ = e.open[g]; }}
        for (k = 0; k < {p}_UNKNOWNS; k++) {{ *out++ = {p}_unknown_param[k]; *out++ = e.scale[k]; }}
        return 0;
    case 2: return {p}_sample(&e, in[0], in + 1, in + 1 + {p}_INPUTS);
    default: {p}_estimate(&e, out, out + {p}_UNKNOWNS); return 0;
    }}
}}
"
    );
    vec![("model.c".into(), text.as_bytes().to_vec()), ("calls.c".into(), calls.into_bytes())]
}

/// What should be, and what the file says, at every sample.
pub(super) fn numbers(model: &Model, folder: &Path) -> Result<Vec<(Numbers, Numbers)>, VerifyError> {
    let library = c_library(folder)?;
    // SAFETY: its type is that of the source above
    let call = unsafe { library.get::<Call>(CALL.as_bytes()) }?;
    // SAFETY: arrays are as long as the functions of the source say
    let ask =
        |which: i32, reads: &[f64], writes: &mut [f64]| unsafe { call(which, reads.as_ptr(), writes.as_mut_ptr()) };
    let constants = constants(model, &ask)?;
    let unknowns: usize = constants.groups.iter().map(|g| g.params.len()).sum();
    let estimator = RecursiveEstimator::with(model, constants).map_err(|e| VerifyError::Estimator(e.to_string()))?;
    let run = record(model, &estimator);
    let iterates = estimator.follow(&run).map_err(|e| VerifyError::Estimator(e.to_string()))?;
    let (m, q) = (run.held.len(), run.output_gaps.len());
    let mut found = Vec::new();
    let mut iterates = iterates.iter();
    for (k, t) in run.time.iter().enumerate() {
        let declared = &run.inputs[k * m..][..m];
        let sample: Vec<f64> = std::iter::once(t).chain(declared).chain(&run.measured[k * q..][..q]).copied().collect();
        if ask(2, &sample, &mut []) <= 0 {
            continue;
        }
        let mut told = vec![f64::NAN; 2 * unknowns];
        ask(3, &[], &mut told);
        let errors = told.split_off(unknowns);
        let expected = iterates.next().map_or((Vec::new(), Vec::new()), |i| (i.values.clone(), i.errors.clone()));
        found.push((vec![(VALUES, expected.0), (ERRORS, expected.1)], vec![(VALUES, told), (ERRORS, errors)]));
    }
    // steps that only the tape took
    found.extend(iterates.map(|i| (vec![(VALUES, i.values.clone())], vec![(VALUES, Vec::new())])));
    Ok(found)
}

/// By what the file says that it is weighed.
fn constants(model: &Model, ask: &Ask<'_>) -> Result<RecursiveConstants, VerifyError> {
    let (layout, definition) = (model.layout(), model.definition());
    let wrong = || VerifyError::Estimator("its sizes are not those of the model".into());
    let mut sizes = [0.0; 6];
    ask(0, &[], &mut sizes);
    let [equations, groups, unknowns, signals, inputs, outputs] = sizes.map(|v| v as usize);
    let declared = definition.inputs.iter().filter(|i| i.is_declared()).count();
    let expected = RecursiveEstimator::equation_count(model).map_err(|e| VerifyError::Estimator(e.to_string()))?;
    let fits = (equations, signals, inputs, outputs) == (expected, layout.inputs, declared, layout.outputs);
    if !fits || groups > equations || unknowns > layout.params {
        return Err(wrong());
    }
    let mut told = vec![0.0; 1 + equations + signals + 2 * groups + 2 * unknowns];
    ask(1, &[], &mut told);
    let (forgetting, rest) = (told[0], &told[1..]);
    let (weights, rest) = rest.split_at(equations);
    let (held, rest) = rest.split_at(signals);
    let (of_groups, of_unknowns) = rest.split_at(2 * groups);
    let mut pairs = of_unknowns.chunks_exact(2);
    let group = |told: &[f64]| {
        let (params, scale): (Vec<u32>, Vec<f64>) =
            pairs.by_ref().take(told[0] as usize).map(|pair| (pair[0] as u32, pair[1])).unzip();
        ParameterGroup { params, scale, open: told[1] }
    };
    let groups: Vec<ParameterGroup> = of_groups.chunks_exact(2).map(group).collect();
    if groups.iter().flat_map(|g| &g.params).any(|k| *k as usize >= layout.params) {
        return Err(wrong());
    }
    let held = held.iter().map(|v| *v != 0.0).collect();
    Ok(RecursiveConstants { forgetting, weights: weights.to_vec(), groups, held, interval: 1.0 })
}

/// Samples at uneven times that wander about.
fn record(model: &Model, estimator: &RecursiveEstimator) -> Run {
    let (definition, layout, mut noise) = (model.definition(), model.layout(), Noise(1));
    let declared = definition.inputs.iter().filter(|i| i.is_declared()).count();
    let q = layout.outputs;
    let longest = estimator.delays().iter().fold(0.0_f64, |most, (_, _, tau)| most.max(*tau));
    // a few samples for each delay, so that all that are kept are read
    let interval = if longest > 0.0 { longest / 3.7 } else { 0.1 };
    let (mut t, mut u, mut y) = (0.0, vec![0.0; declared], vec![1.0; q]);
    let mut run = Run {
        name: "verified".into(),
        time: Vec::new(),
        inputs: Vec::new(),
        held: estimator.constants().held[..declared].to_vec(),
        measured: Vec::new(),
        input_gaps: vec![0; declared],
        stated: Vec::new(),
        output_gaps: vec![0; q],
    };
    // samples of the record
    for _ in 0..300 {
        run.time.push(t);
        run.inputs.extend(&u);
        run.measured.extend(&y);
        t += interval * (1.0 + 0.2 * noise.next());
        u.iter_mut().zip(&definition.inputs).filter(|(_, i)| !i.known).for_each(|(u, _)| *u = 0.9 * *u + noise.next());
        y.iter_mut().for_each(|y| *y = 0.9 * *y + 0.1 + noise.next());
    }
    run
}
