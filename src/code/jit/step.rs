//! One whole Runge-Kutta step as one function: four stages in line, the states in registers between them.
//!
//! The order of operations is that of `dynamics::runge_kutta`, so that the results are the same bits.

use super::module::Callees;
use super::translate::{Leaves, States, Translator, load, store};
use cranelift_codegen::ir::{InstBuilder, Type, Value, types};
use cranelift_frontend::FunctionBuilder;
use fdm_grammar::schedule::{Layout, Program};

/// Address of a compiled step: t, h, x, drive, known, next, stages.
pub(super) type Advance = unsafe extern "C" fn(f64, f64, *const f64, *const f64, *const f64, *mut f64, *mut f64);

/// The parameters of [`Advance`].
pub(super) fn params(pointer: Type) -> [Type; 7] {
    [types::F64, types::F64, pointer, pointer, pointer, pointer, pointer]
}

/// Translates a step of a program whose first results are the rates; the results of each stage are stored as one row
/// of `stages` when `rows` says so.
pub(super) fn step(
    program: &Program,
    layout: &Layout,
    rows: bool,
    builder: &mut FunctionBuilder<'_>,
    callees: &mut Callees<'_>,
) {
    let block = builder.create_block();
    builder.append_block_params_for_function_params(block);
    builder.switch_to_block(block);
    builder.seal_block(block);
    let [t, h, x, drive, known, next, stages] = std::array::from_fn(|k| builder.block_params(block)[k]);
    let n = layout.states;
    let constant = |builder: &mut FunctionBuilder<'_>, value: f64| builder.ins().f64const(value);
    let half = constant(builder, 0.5);
    let half = builder.ins().fmul(half, h);
    let middle = builder.ins().fadd(t, half);
    let end = builder.ins().fadd(t, h);
    let start: Vec<Value> = (0..n).map(|i| load(builder, x, i)).collect();
    let mut states = start.clone();
    let mut slopes: Vec<Vec<Value>> = Vec::with_capacity(4);
    let mut translator = Translator::new(program);
    // time, row of the drive, reach of the next stage from the step's beginning
    for (stage, (time, row, reach)) in
        [(t, 0, half), (middle, 1, half), (middle, 1, h), (end, 2, h)].into_iter().enumerate()
    {
        // the third stage stands at the same time as the second
        translator.forget(stage == 2);
        let leaves = Leaves { time, states: States::Registers(&states), drive: (drive, row * layout.drive()), known };
        let row = stage * program.width;
        let mut rates = Vec::with_capacity(n);
        for result in &program.results {
            let (k, value) = (result.slot as usize, translator.value(result.operand, leaves, builder, callees));
            if k < n {
                rates.push(value);
            }
            if rows {
                store(builder, value, stages, row + k);
            }
        }
        if stage < 3 {
            let moved = |builder: &mut FunctionBuilder<'_>, i: usize| {
                let way = builder.ins().fmul(reach, rates[i]);
                builder.ins().fadd(start[i], way)
            };
            states = (0..n).map(|i| moved(builder, i)).collect();
        }
        slopes.push(rates);
    }
    let (six, three) = (constant(builder, 6.0), constant(builder, 3.0));
    let sixth = builder.ins().fdiv(h, six);
    let third = builder.ins().fdiv(h, three);
    for i in 0..n {
        let [k1, k2, k3, k4] = std::array::from_fn(|stage| slopes[stage][i]);
        let first = builder.ins().fmul(sixth, k1);
        let first = builder.ins().fadd(start[i], first);
        let inner = builder.ins().fadd(k2, k3);
        let inner = builder.ins().fmul(third, inner);
        let sum = builder.ins().fadd(first, inner);
        let last = builder.ins().fmul(sixth, k4);
        let sum = builder.ins().fadd(sum, last);
        store(builder, sum, next, i);
    }
    builder.ins().return_(&[]);
}
