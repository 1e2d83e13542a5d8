//! The one place that holds Cranelift's module: host flags, elementary functions, executable memory and its end.

use crate::code::JitError;
use cranelift_codegen::Context;
use cranelift_codegen::ir::{AbiParam, FuncRef, Function, InstBuilder, Type, Value, types};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{FuncId, Linkage, Module, default_libcall_names};
use fdm_grammar::math;
use fdm_grammar::op::{Op, ROWS};
use std::mem::ManuallyDrop;

/// Executable memory and what is needed to add to it.
pub(super) struct CodeModule {
    /// Taken when this is dropped, not before.
    module: ManuallyDrop<JITModule>,
    context: Context,
    scratch: FunctionBuilderContext,
    /// What the code refers to by address.
    tables: Vec<Box<[f64]>>,
    /// For each operation the function that computes it, unless the hardware does.
    elementary: Vec<Option<FuncId>>,
    /// The last function's instructions as text, when somebody wants to read them.
    pub(super) written: Option<String>,
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
    pub(super) fn new() -> Result<Self, JitError> {
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
    pub(super) fn pointer(&self) -> Type {
        self.module.target_config().pointer_type()
    }

    /// Compiles a function of these parameters without result, which may refer to a table of constants; its address
    /// is valid as long as this lives.
    pub(super) fn define(
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
pub(super) struct Callees<'a> {
    module: &'a mut JITModule,
    constants: *const f64,
    elementary: &'a [Option<FuncId>],
    referred: Vec<Option<FuncRef>>,
}

impl Callees<'_> {
    /// The type of addresses.
    pub(super) fn pointer(&self) -> Type {
        self.module.target_config().pointer_type()
    }

    /// The address of the table of constants.
    pub(super) fn constants(&self, builder: &mut FunctionBuilder<'_>) -> Value {
        let pointer = self.pointer();
        builder.ins().iconst(pointer, self.constants as i64)
    }

    /// The function that computes an operation; `None` when the hardware does.
    pub(super) fn of(&mut self, op: Op, function: &mut Function) -> Option<FuncRef> {
        let id = self.elementary[op as usize]?;
        Some(*self.referred[op as usize].get_or_insert_with(|| self.module.declare_func_in_func(id, function)))
    }
}

/// Away from the names of the system's C library.
fn symbol(name: &str) -> String {
    format!("fdm.{name}")
}
