//! Native code for the programs of a model, made by Cranelift when a program is first asked for.
//!
//! **In** a schedule. **Out** [`Jit`]. **Never** an operation that Cranelift could round otherwise than Rust: the
//! elementary functions are called. **Start** at [`Jit::new`]; `translate.rs` says what each operation becomes.
//!
//! Compiling takes about as long as a thousand runs of the tape. What is evaluated once per parameter vector or once
//! per model or event (`prepare`, `by_input`, the partials of events) is therefore left to the tape, and so are programs over [`LONGEST`] instructions.
//! All `unsafe` of the project is in this folder.
//!
//! The one place that holds Cranelift's module: host flags, elementary functions, executable memory and its end.

#![allow(unsafe_code)]

use super::{JitError, Tape};
use crate::dynamics::{Dynamics, Point, Step, Workspace, by_stages, by_stages_with_partials};
use cranelift_codegen::Context;
use cranelift_codegen::ir::{AbiParam, FuncRef, Function, InstBuilder, Type, Value, types};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{FuncId, Linkage, Module, default_libcall_names};
use fdm_grammar::math;
use fdm_grammar::op::{Op, ROWS};
use fdm_grammar::schedule::{Layout, Operand, Program, Schedule};
use std::mem::ManuallyDrop;
use std::sync::{Mutex, OnceLock};
use translate::{Advance, Leaves, Plan, States, Translator};

mod translate;

/// Most instructions and results of a program that is compiled.
const LONGEST: usize = 30_000;

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
    /// Of states, three rows of the drive and what `prepare` computes, as every step checks them.
    lengths: [usize; 3],
    module: Mutex<CodeModule>,
    rates: Lazy<Evaluate>,
    rates_and_partials: Lazy<Evaluate>,
    outputs: Lazy<Evaluate>,
    outputs_and_partials: Lazy<Evaluate>,
    events: Lazy<Evaluate>,
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
            lengths: [schedule.layout.states, 3 * schedule.layout.drive(), schedule.layout.known],
            module: Mutex::new(apart(CodeModule::new)??),
            rates: Lazy::new(),
            rates_and_partials: Lazy::new(),
            outputs: Lazy::new(),
            outputs_and_partials: Lazy::new(),
            events: Lazy::new(),
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
        let stages = match rows {
            Some(rows) => {
                assert!(rows.len() >= 4 * program.width, "rows shorter than the layout says");
                rows.as_mut_ptr()
            }
            None => std::ptr::null_mut(),
        };
        let [states, drives, values] = self.lengths;
        assert!(
            step.x.len() >= states && step.drive.len() >= drives && step.known.len() >= values && next.len() >= states,
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
        if !program.calls.is_empty() || size(program) > LONGEST || !is_inside(program, &self.schedule.layout) {
            return None;
        }
        let plan = Plan::new(program, self.schedule.layout.states.min(program.results.len()));
        // most numbers in the frame of a function: it must fit on the stack of any thread
        if plan.frame > 16_000 {
            return None;
        }
        self.define(|module| {
            let pointer = module.pointer();
            let params = [types::F64, pointer, pointer, pointer, pointer];
            let address = module.define(&params, &program.constants, |builder, callees| {
                evaluation(program, &plan, builder, callees);
            })?;
            // SAFETY: the function was defined with the parameters of `Evaluate` and the platform's C convention.
            Ok(unsafe { std::mem::transmute::<*const u8, Evaluate>(address) })
        })
    }

    /// The machine code of the programs that are compiled, as text; none where the tape does the work.
    pub fn listing(&self) -> Vec<(&'static str, Option<String>)> {
        let schedule = &self.schedule;
        let programs = [
            ("rates", &schedule.rates),
            ("rates_and_partials", &schedule.rates_and_partials),
            ("outputs", &schedule.outputs),
            ("outputs_and_partials", &schedule.outputs_and_partials),
        ];
        let write =
            |on: Option<String>| self.module.lock().ok().and_then(|mut m| std::mem::replace(&mut m.written, on));
        let listed = programs.map(|(name, program)| {
            write(Some(String::new()));
            let compiled = self.compile(program).is_some();
            (name, write(None).filter(|_| compiled))
        });
        listed.into()
    }

    #[cold]
    fn compile_step(&self, program: &Program, rows: bool) -> Option<Advance> {
        let layout = &self.schedule.layout;
        let rates = program.results.iter().take(layout.states).enumerate().filter(|(i, r)| r.slot as usize == *i);
        if !program.calls.is_empty()
            // most instructions and results of a program that is compiled four times over, as one step
            || size(program) > 1_500
            || rates.count() < layout.states
            || !is_inside(program, layout)
        {
            return None;
        }
        let plan = Plan::new(program, layout.states);
        self.define(|module| {
            let params = translate::step_params(module.pointer());
            let address = module.define(&params, &program.constants, |builder, callees| {
                translate::step(program, &plan, layout, rows, builder, callees);
            })?;
            // SAFETY: the function was defined with the parameters of `Advance` and the platform's C convention.
            Ok(unsafe { std::mem::transmute::<*const u8, Advance>(address) })
        })
    }

    /// Makes a function on a thread of its own; `None` when that fails, and ever after the compiler has panicked.
    fn define<F: Send>(&self, make: impl FnOnce(&mut CodeModule) -> Result<F, JitError> + Send) -> Option<F> {
        let made = apart(|| {
            let mut module = self.module.lock().map_err(|_| JitError::Panicked)?;
            make(&mut module)
        });
        made.flatten().ok()
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

    fn events(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        if !self.evaluate(&self.events, &self.schedule.events, at, out) {
            self.tape.events(at, out, work);
        }
    }

    fn events_and_partials(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.tape.events_and_partials(at, out, work);
    }

    fn rates_by_time(&self, at: Point<'_>, out: &mut [f64], work: &mut Workspace) {
        self.tape.rates_by_time(at, out, work);
    }

    fn ready(&self) -> Result<(), String> {
        self.tape.ready()
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
        // stack of the thread that compiles; pages that are not touched cost nothing
        let thread = std::thread::Builder::new().name("compile model".into()).stack_size(64 << 20);
        thread.spawn_scoped(scope, make)?.join().map_err(|_| JitError::Panicked)
    })
}

/// Everything that takes time to compile.
fn size(program: &Program) -> usize {
    program.instructions.len() + program.results.len()
}

/// Whether a program reads nothing outside the layout and no value before it is computed, and all offsets are small
/// enough for an instruction: what makes its code safe.
fn is_inside(program: &Program, layout: &Layout) -> bool {
    const FARTHEST: usize = 1 << 24;
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
        && program.results.iter().all(|r| inside(&r.operand, program.instructions.len()))
        && program.results.iter().all(|r| (r.slot as usize) < program.width)
        && [program.constants.len(), layout.states, layout.drive(), layout.known, program.width]
            .into_iter()
            .all(|length| length < FARTHEST)
}

/// The body of an [`Evaluate`].
fn evaluation(program: &Program, plan: &Plan, builder: &mut FunctionBuilder<'_>, callees: &mut Callees<'_>) {
    let (mut translator, [time, x, drive, known, out]) = Translator::new(program, plan, 0, builder, callees);
    let leaves = Leaves { time, states: States::Memory(x), drive: (drive, 0), known };
    translator.point(&leaves, false, Some((out, 0)), &mut []);
    translator.builder.ins().return_(&[]);
}

/// Executable memory and what is needed to add to it.
struct CodeModule {
    /// Taken when this is dropped, not before.
    module: ManuallyDrop<JITModule>,
    context: Context,
    scratch: FunctionBuilderContext,
    /// What the code refers to by address.
    tables: Vec<Box<[f64]>>,
    /// For each operation the function that computes it, unless the hardware does.
    elementary: Vec<Option<FuncId>>,
    /// The last function's instructions as text, when somebody wants to read them.
    written: Option<String>,
}

macro_rules! elementary {
    ($($op:ident $name:ident($($x:ident),*);)*) => {
        $(extern "C" fn $name($($x: f64),*) -> f64 {
            math::$name($($x),*)
        })*

        /// Address and number of arguments of what hardware does not compute; the table's functions to the bit.
        fn function(op: Op) -> Option<(*const u8, usize)> {
            match op {
                $(Op::$op => Some(($name as *const u8, [$(stringify!($x)),*].len())),)*
                _ => None,
            }
        }
    };
}

elementary! {
    Pow pow(x, y);
    Sin sin(x);
    Cos cos(x);
    Tan tan(x);
    Asin asin(x);
    Acos acos(x);
    Atan atan(x);
    Atan2 atan2(y, x);
    Sinh sinh(x);
    Cosh cosh(x);
    Tanh tanh(x);
    Exp exp(x);
    Log log(x);
    Log10 log10(x);
    Hypot hypot(x, y);
}

impl CodeModule {
    /// An empty module for this machine.
    fn new() -> Result<Self, JitError> {
        let flags = [
            // the graph has no common or constant subexpressions left, and the optimiser would write everything down as
            // late as it can: long lives, which its register allocator answers with quadratic time and spills
            ("opt_level", "none"),
            // a straight line of verified arithmetic: nothing to unwind, nothing that Cranelift should check again
            ("enable_verifier", "false"),
            ("unwind_info", "false"),
            // a large frame must find the guard page, not step over it
            ("enable_probestack", "true"),
            ("probestack_strategy", "inline"),
        ];
        let mut builder = JITBuilder::with_flags(&flags, default_libcall_names())?;
        for row in ROWS {
            if let Some((address, _)) = function(row.op) {
                builder.symbol(symbol(row.name), address);
            }
        }
        let mut module = JITModule::new(builder);
        let mut elementary = Vec::with_capacity(ROWS.len());
        for row in ROWS {
            elementary.push(match function(row.op) {
                Some((_, arity)) => {
                    let mut signature = module.make_signature();
                    signature.params = vec![AbiParam::new(types::F64); arity];
                    signature.returns = vec![AbiParam::new(types::F64)];
                    Some(module.declare_function(&symbol(row.name), Linkage::Import, &signature)?)
                }
                None => None,
            });
        }
        let context = module.make_context();
        let (module, scratch) = (ManuallyDrop::new(module), FunctionBuilderContext::new());
        Ok(Self { module, context, scratch, tables: Vec::new(), elementary, written: None })
    }

    /// The type of addresses.
    fn pointer(&self) -> Type {
        self.module.target_config().pointer_type()
    }

    /// Compiles a function of these parameters without result, which may refer to a table of constants; its address
    /// is valid as long as this lives.
    fn define(
        &mut self,
        params: &[Type],
        constants: &[f64],
        body: impl FnOnce(&mut FunctionBuilder<'_>, &mut Callees<'_>),
    ) -> Result<*const u8, JitError> {
        let module = &mut *self.module;
        module.clear_context(&mut self.context);
        self.context.func.signature.params = params.iter().map(|t| AbiParam::new(*t)).collect();
        let id = module.declare_anonymous_function(&self.context.func.signature)?;
        let table: Box<[f64]> = constants.into();
        let address = table.as_ptr();
        self.tables.push(table);
        self.context.set_disasm(self.written.is_some());
        let mut builder = FunctionBuilder::new(&mut self.context.func, &mut self.scratch);
        let mut callees =
            Callees { module, constants: address, elementary: &self.elementary, referred: vec![None; ROWS.len()] };
        body(&mut builder, &mut callees);
        builder.finalize(module.target_config());
        module.define_function(id, &mut self.context)?;
        if let Some(written) = &mut self.written {
            *written = self.context.compiled_code().and_then(|code| code.vcode.clone()).unwrap_or_default();
        }
        module.finalize_definitions()?;
        Ok(module.get_finalized_function(id))
    }
}

impl Drop for CodeModule {
    fn drop(&mut self) {
        // SAFETY: taken here only, and `self` is not used afterwards.
        let module = unsafe { ManuallyDrop::take(&mut self.module) };
        // SAFETY: `Jit` owns this module and the only copies of its addresses, and it is being dropped: nobody can be
        // inside a function nor call one afterwards.
        unsafe { module.free_memory() };
    }
}

/// What the function under construction refers to.
struct Callees<'a> {
    module: &'a mut JITModule,
    constants: *const f64,
    elementary: &'a [Option<FuncId>],
    referred: Vec<Option<FuncRef>>,
}

impl Callees<'_> {
    /// The type of addresses.
    fn pointer(&self) -> Type {
        self.module.target_config().pointer_type()
    }

    /// The address of the table of constants.
    fn constants(&self, builder: &mut FunctionBuilder<'_>) -> Value {
        let pointer = self.pointer();
        builder.ins().iconst(pointer, self.constants as i64)
    }

    /// The function that computes an operation; `None` when the hardware does.
    fn of(&mut self, op: Op, function: &mut Function) -> Option<FuncRef> {
        let id = self.elementary[op as usize]?;
        Some(*self.referred[op as usize].get_or_insert_with(|| self.module.declare_func_in_func(id, function)))
    }
}

/// Away from the names of the system's C library.
fn symbol(name: &str) -> String {
    format!("fdm.{name}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::code::specimen::{blank, random, ship};
    use fdm_grammar::graph::Leaf;
    use fdm_grammar::op::{Build, Op};

    fn made(schedule: &Schedule) -> Jit {
        Jit::new(schedule).expect("this machine is supported")
    }

    #[test]
    fn programs_become_native_code() {
        for mut model in [ship(), random(3, true), random(5, true), blank(0, 0, &[])] {
            let schedule = Schedule::new(&mut model);
            let jit = made(&schedule);
            for program in [&schedule.rates, &schedule.rates_and_partials, &schedule.outputs_and_partials] {
                assert!(jit.compile(program).is_some());
            }
            assert!(jit.compile_step(&schedule.rates, false).is_some());
            assert!(jit.compile_step(&schedule.rates_and_partials, true).is_some());
        }
    }

    /// A program of one chain, as deep as it is long.
    fn chain(length: u32) -> Schedule {
        let mut model = blank(1, 0, &[]);
        let mut e = model.graph.leaf(Leaf::State(0));
        let half = model.graph.number(0.5);
        for k in 0..length {
            e = match k % 3 {
                0 => model.graph.apply(Op::Sqrt, &[e]),
                1 => model.graph.apply(Op::Sub, &[half, e]),
                _ => model.graph.apply(Op::Abs, &[e]),
            };
        }
        model.states[0].rate = e;
        Schedule::new(&mut model)
    }

    #[test]
    fn deep_programs_compile_and_longer_ones_are_left_to_the_tape() {
        let schedule = chain(6_000);
        assert!(made(&schedule).compile(&schedule.rates).is_some());
        let schedule = chain(LONGEST as u32 + 1);
        assert!(made(&schedule).compile(&schedule.rates).is_none());
    }

    #[test]
    fn a_program_that_reads_outside_its_layout_is_not_compiled() {
        let mut schedule = Schedule::new(&mut ship());
        schedule.rates.instructions[0].args[0] = Operand::State(3);
        assert!(made(&schedule).compile(&schedule.rates).is_none());
        let mut schedule = Schedule::new(&mut ship());
        schedule.rates.instructions[0].args[0] = Operand::Value(0);
        assert!(made(&schedule).compile(&schedule.rates).is_none());
    }

    #[test]
    #[should_panic(expected = "shorter than the layout")]
    fn short_arrays_are_refused() {
        let schedule = Schedule::new(&mut ship());
        let jit = made(&schedule);
        let at = Point { t: 0.0, x: &[0.0; 3], drive: &[0.0], known: &[0.0; 2] };
        jit.rates(at, &mut [0.0; 3], &mut Workspace::default());
    }

    #[test]
    fn threads_share_a_model() {
        let schedule = Schedule::new(&mut ship());
        let jit = made(&schedule);
        let known = vec![0.5; schedule.layout.known];
        let rates = || {
            let (mut out, at) = ([0.0; 3], Point { t: 0.0, x: &[1.0, 2.0, 3.0], drive: &[0.1], known: &known });
            jit.rates(at, &mut out, &mut Workspace::new(&jit));
            out.map(f64::to_bits)
        };
        let results: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(rates)).collect();
            threads.into_iter().map(|t| t.join().expect("no thread panics")).collect()
        });
        assert!(results.iter().all(|r| *r == results[0]));
    }
}
