//! Native code for the programs of a model, made by Cranelift when a program is first asked for.
//!
//! Compiling takes about as long as a thousand runs of the tape. What is evaluated once per parameter vector or once
//! per model (`prepare`, `by_input`) is therefore left to the tape, and so are programs over [`LONGEST`] instructions.
//! All `unsafe` of the project is in this folder.
#![allow(unsafe_code)]

mod module;
mod step;
mod translate;

use super::Tape;
use crate::dynamics::{Dynamics, Point, Step, Workspace, by_stages, by_stages_with_partials};
use cranelift_codegen::ir::{InstBuilder, Type, types};
use cranelift_frontend::FunctionBuilder;
use fdm_grammar::schedule::{Layout, Operand, Program, Schedule};
use module::{Callees, CodeModule};
use std::sync::{Mutex, OnceLock};
use step::Advance;
use translate::{Leaves, States, Translator, store};

/// Most instructions of a program that is compiled.
const LONGEST: usize = 30_000;
/// Most instructions of a program that is compiled four times over, as one step.
const LONGEST_STAGE: usize = 1_500;
/// Stack of the thread that compiles; pages that are not touched cost nothing.
const STACK: usize = 256 << 20;

/// Why there is no machine code.
#[derive(Debug, thiserror::Error)]
pub enum JitError {
    /// The compiler refused: this machine is not supported, or memory could not be made executable.
    #[error("no machine code can be made here: {0}")]
    Module(#[from] Box<cranelift_module::ModuleError>),
    /// The compiler stopped in the middle, or this machine is unknown to it.
    #[error("the compiler of machine code stopped unexpectedly")]
    Panicked,
    /// There is no thread to compile on.
    #[error("no thread to compile on: {0}")]
    Thread(#[from] std::io::Error),
}

impl From<cranelift_module::ModuleError> for JitError {
    fn from(e: cranelift_module::ModuleError) -> Self {
        Self::Module(Box::new(e))
    }
}

/// Address of a compiled program: t, x, drive, known, out.
type Evaluate = unsafe extern "C" fn(f64, *const f64, *const f64, *const f64, *mut f64);

/// Code of one function, made at its first call; `None` when the tape is to do it.
type Lazy<F> = OnceLock<Option<F>>;

/// Machine code of a model; where there is none, its tape.
pub struct Jit {
    schedule: Schedule,
    tape: Tape,
    module: Mutex<CodeModule>,
    rates: Lazy<Evaluate>,
    rates_and_partials: Lazy<Evaluate>,
    outputs: Lazy<Evaluate>,
    outputs_and_partials: Lazy<Evaluate>,
    step: Lazy<Advance>,
    step_with_partials: Lazy<Advance>,
}

impl Jit {
    /// Prepares this machine's compiler; programs are compiled when they are first evaluated.
    ///
    /// # Errors
    /// When no machine code can be made for this machine or in this process; use [`Tape`] then.
    pub fn new(schedule: &Schedule) -> Result<Self, JitError> {
        Ok(Self {
            schedule: schedule.clone(),
            tape: Tape::new(schedule),
            module: Mutex::new(apart(CodeModule::new)??),
            rates: Lazy::new(),
            rates_and_partials: Lazy::new(),
            outputs: Lazy::new(),
            outputs_and_partials: Lazy::new(),
            step: Lazy::new(),
            step_with_partials: Lazy::new(),
        })
    }

    /// Runs the code of a program; false when the tape is to do it.
    #[inline]
    fn evaluate(&self, code: &Lazy<Evaluate>, program: &Program, at: Point<'_>, out: &mut [f64]) -> bool {
        let Some(code) = *code.get_or_init(|| self.compile(program)) else { return false };
        let layout = &self.schedule.layout;
        assert!(
            at.x.len() >= layout.states
                && at.drive.len() >= layout.drive()
                && at.known.len() >= layout.known
                && out.len() >= program.width,
            "arrays shorter than the layout says"
        );
        // SAFETY: `compile` made this code from `program`, whose operands it found inside the layout: it reads
        // `states`, `drive()` and `known` numbers and writes only below `width`, all of which were just asserted to be
        // there; `out` is borrowed mutably and so overlaps nothing. The code lives as long as `self.module`.
        unsafe { code(at.t, at.x.as_ptr(), at.drive.as_ptr(), at.known.as_ptr(), out.as_mut_ptr()) };
        true
    }

    /// Runs the code of a step; false when it is to be done stage by stage. `rows` is empty when nobody asks for it.
    #[inline]
    fn advance(
        &self,
        code: &Lazy<Advance>,
        program: &Program,
        step: Step<'_>,
        next: &mut [f64],
        rows: Option<&mut [f64]>,
    ) -> bool {
        let Some(code) = *code.get_or_init(|| self.compile_step(program, rows.is_some())) else { return false };
        let layout = &self.schedule.layout;
        let stages = match rows {
            Some(rows) => {
                assert!(rows.len() >= 4 * program.width, "rows shorter than the layout says");
                rows.as_mut_ptr()
            }
            None => std::ptr::null_mut(),
        };
        assert!(
            step.x.len() >= layout.states
                && step.drive.len() >= 3 * layout.drive()
                && step.known.len() >= layout.known
                && next.len() >= layout.states,
            "arrays shorter than the layout says"
        );
        let Step { t, h, x, drive, known } = step;
        // SAFETY: as in `evaluate`; the drive has three rows. Each `Lazy` belongs to one method, which always or never
        // passes rows: code that writes them was compiled with them.
        unsafe { code(t, h, x.as_ptr(), drive.as_ptr(), known.as_ptr(), next.as_mut_ptr(), stages) };
        true
    }

    #[cold]
    fn compile(&self, program: &Program) -> Option<Evaluate> {
        if program.instructions.len() > LONGEST || !is_inside(program, &self.schedule.layout) {
            return None;
        }
        self.define(|module, pointer| {
            let params = [types::F64, pointer, pointer, pointer, pointer];
            let address = module.define(&params, |builder, callees| evaluation(program, builder, callees))?;
            // SAFETY: the function was defined with the parameters of `Evaluate` and the platform's C convention.
            Ok(unsafe { std::mem::transmute::<*const u8, Evaluate>(address) })
        })
    }

    #[cold]
    fn compile_step(&self, program: &Program, rows: bool) -> Option<Advance> {
        let layout = &self.schedule.layout;
        let small = program.instructions.len() <= LONGEST_STAGE && program.results.len() <= LONGEST_STAGE;
        if !small || program.results.len() < layout.states || !is_inside(program, layout) {
            return None;
        }
        self.define(|module, pointer| {
            let address = module.define(&step::params(pointer), |builder, callees| {
                step::step(program, layout, rows, builder, callees);
            })?;
            // SAFETY: the function was defined with the parameters of `Advance` and the platform's C convention.
            Ok(unsafe { std::mem::transmute::<*const u8, Advance>(address) })
        })
    }

    /// Makes a function on a thread of its own; `None` when that fails, also because it once panicked before.
    fn define<F: Send>(&self, make: impl FnOnce(&mut CodeModule, Type) -> Result<F, JitError> + Send) -> Option<F> {
        let made = apart(|| {
            let mut module = self.module.lock().map_err(|_| JitError::Panicked)?;
            let pointer = module.pointer()?;
            make(&mut module, pointer)
        });
        made.and_then(|f| f).ok()
    }
}

impl Dynamics for Jit {
    fn layout(&self) -> &Layout {
        &self.schedule.layout
    }

    fn workspace(&self) -> usize {
        self.tape.workspace()
    }

    fn prepare(&self, theta: &[f64], known: &mut [f64], work: &mut Workspace) {
        self.tape.prepare(theta, known, work);
    }

    fn rates(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if !self.evaluate(&self.rates, &self.schedule.rates, at, out) {
            self.tape.rates(at, out, work);
        }
    }

    fn rates_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if !self.evaluate(&self.rates_and_partials, &self.schedule.rates_and_partials, at, out) {
            self.tape.rates_and_partials(at, out, work);
        }
    }

    fn outputs(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if !self.evaluate(&self.outputs, &self.schedule.outputs, at, out) {
            self.tape.outputs(at, out, work);
        }
    }

    fn outputs_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if !self.evaluate(&self.outputs_and_partials, &self.schedule.outputs_and_partials, at, out) {
            self.tape.outputs_and_partials(at, out, work);
        }
    }

    fn by_input(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.tape.by_input(at, out, work);
    }

    fn step(&self, step: Step<'_>, next: &mut [f64], work: &mut Workspace) {
        if !self.advance(&self.step, &self.schedule.rates, step, next, None) {
            by_stages(self, step, next, work);
        }
    }

    fn step_with_partials(&self, step: Step<'_>, next: &mut [f64], stages: &mut [f64], work: &mut Workspace) {
        let program = &self.schedule.rates_and_partials;
        if !self.advance(&self.step_with_partials, program, step, next, Some(stages)) {
            by_stages_with_partials(self, step, next, stages, work);
        }
    }
}

/// Runs on a thread with a stack for the compiler; a panic there becomes an error.
fn apart<T: Send>(make: impl FnOnce() -> T + Send) -> Result<T, JitError> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("compile model".into()).stack_size(STACK);
        thread.spawn_scoped(scope, make)?.join().map_err(|_| JitError::Panicked)
    })
}

/// Whether a program reads nothing outside the layout and no value before it is computed: what makes its code safe.
fn is_inside(program: &Program, layout: &Layout) -> bool {
    let inside = |operand: &Operand, values: usize| match *operand {
        Operand::Value(k) => (k as usize) < values,
        Operand::Constant(k) => (k as usize) < program.constants.len(),
        Operand::Time => true,
        Operand::State(k) => (k as usize) < layout.states,
        Operand::Drive(k) => (k as usize) < layout.drive(),
        Operand::Known(k) => (k as usize) < layout.known,
    };
    let mut instructions = program.instructions.iter().enumerate();
    instructions.all(|(k, i)| i.args.iter().all(|a| inside(a, k)))
        && program
            .results
            .iter()
            .all(|r| inside(&r.operand, program.instructions.len()) && (r.slot as usize) < program.width)
}

/// The body of an [`Evaluate`].
fn evaluation(program: &Program, builder: &mut FunctionBuilder<'_>, callees: &mut Callees<'_>) {
    let block = builder.create_block();
    builder.append_block_params_for_function_params(block);
    builder.switch_to_block(block);
    builder.seal_block(block);
    let [time, x, drive, known, out] = std::array::from_fn(|k| builder.block_params(block)[k]);
    let leaves = Leaves { time, states: States::Memory(x), drive: (drive, 0), known };
    let mut translator = Translator::new(program);
    for result in &program.results {
        let value = translator.value(result.operand, leaves, builder, callees);
        store(builder, value, out, result.slot as usize);
    }
    builder.ins().return_(&[]);
}
