//! One whole Runge-Kutta step as one function: four stages in line, the states in registers between them.
//!
//! The order of operations is that of `dynamics::runge_kutta`, so that the results are the same bits. Each stage
//! computes its rates first: the next stage waits for them, and for nothing else. On x86 a number that goes through
//! memory is some ten cycles late, so rates stay in registers until the next stage has begun (unless the program is so
//! long that this does not matter); for the sum at the end they are read back from the rows.

use super::module::Callees;
use super::plan::Plan;
use super::translate::{Leaves, States, Translator, load, store};
use cranelift_codegen::ir::{InstBuilder, Type, Value, types};
use cranelift_frontend::FunctionBuilder;
use fdm_grammar::schedule::{Layout, Program};

/// Address of a compiled step: t, h, x, drive, known, next, rows.
pub(super) type Advance = unsafe extern "C" fn(f64, f64, *const f64, *const f64, *const f64, *mut f64, *mut f64);

/// The parameters of [`Advance`].
pub(super) fn params(pointer: Type) -> [Type; 7] {
    [types::F64, types::F64, pointer, pointer, pointer, pointer, pointer]
}

/// Translates a step of a program whose first results are the rates; with `rows` the results of each stage are stored
/// as one row of `rows`.
pub(super) fn step(
    program: &Program,
    plan: &Plan,
    layout: &Layout,
    rows: bool,
    builder: &mut FunctionBuilder<'_>,
    callees: &mut Callees<'_>,
) {
    let (n, width) = (layout.states, program.width);
    let (mut translator, params) = Translator::new(program, plan, n, builder, callees);
    let [t, h, x, drive, known, next, out] = params;
    let half = translator.builder.ins().f64const(0.5);
    let half = translator.builder.ins().fmul(half, h);
    let middle = translator.builder.ins().fadd(t, half);
    let end = translator.builder.ins().fadd(t, h);

    let mut slopes: Vec<Vec<Value>> = Vec::with_capacity(4);
    // time, row of the drive, reach from the step's beginning
    let stages = [(t, 0, None), (middle, 1, Some(half)), (middle, 1, Some(half)), (end, 2, Some(h))];
    for (stage, (time, row, reach)) in stages.into_iter().enumerate() {
        if rows
            && translator.is_long()
            && let Some(last) = slopes.last_mut()
        {
            *last = (0..n).map(|i| load(translator.builder, out, (stage - 1) * width + i)).collect();
        }
        let states = states(x, reach.zip(slopes.last()), n, translator.builder);
        let drive = (drive, row * layout.drive());
        let leaves = Leaves { time, states: States::Registers(&states), drive, known };
        let mut rates = vec![time; n];
        // the third stage stands where the second stood, but for the states
        translator.point(&leaves, stage == 2, rows.then_some((out, stage * width)), &mut rates);
        slopes.push(rates);
    }
    let again = |builder: &mut FunctionBuilder<'_>, stage: usize, i: usize| match rows && stage < 3 {
        true => load(builder, out, stage * width + i),
        false => slopes[stage][i],
    };
    finish(h, x, next, n, again, translator.builder);
    translator.builder.ins().return_(&[]);
}

/// The states of a stage: those of the step's beginning, moved by reach times slope.
fn states(x: Value, moved: Option<(Value, &Vec<Value>)>, n: usize, builder: &mut FunctionBuilder<'_>) -> Vec<Value> {
    let state = |i| {
        let from = load(builder, x, i);
        match moved {
            Some((reach, slopes)) => {
                let way = builder.ins().fmul(reach, slopes[i]);
                builder.ins().fadd(from, way)
            }
            None => from,
        }
    };
    (0..n).map(state).collect()
}

/// The weighted sum of the slopes.
fn finish(
    h: Value,
    x: Value,
    next: Value,
    n: usize,
    slope: impl Fn(&mut FunctionBuilder<'_>, usize, usize) -> Value,
    builder: &mut FunctionBuilder<'_>,
) {
    let (six, three) = (builder.ins().f64const(6.0), builder.ins().f64const(3.0));
    let (sixth, third) = (builder.ins().fdiv(h, six), builder.ins().fdiv(h, three));
    for i in 0..n {
        let [k1, k2, k3, k4] = std::array::from_fn(|stage| slope(builder, stage, i));
        let from = load(builder, x, i);
        let first = builder.ins().fmul(sixth, k1);
        let first = builder.ins().fadd(from, first);
        let inner = builder.ins().fadd(k2, k3);
        let inner = builder.ins().fmul(third, inner);
        let sum = builder.ins().fadd(first, inner);
        let last = builder.ins().fmul(sixth, k4);
        let sum = builder.ins().fadd(sum, last);
        store(builder, sum, next, i);
    }
}
