//! Programs to Rust: straight lines of `let`s over fixed-size arrays, and the implementation of `Dynamics` around them.
//! No identifier of the user enters the code; values are `v0`, `v1`, ...

use fdm_grammar::emit::{Notation, RustNotation, statements};
use fdm_grammar::schedule::Operand;
use fdm_grammar::{Layout, Program, Schedule};
use proc_macro2::{Literal, TokenStream};
use quote::{format_ident, quote};
use std::path::Path;

/// rustc needs about a second for every 5,000 instructions, and the machine code of the file door is as good.
pub(crate) const MOST_INSTRUCTIONS: usize = 20_000;

/// Longer programs are called from the four stages of a step instead of being copied into each.
const MOST_COPIED: usize = 2_000;

const NOTATION: RustNotation<'static> = RustNotation { elementary: "::fdm::math::", exact: "::fdm::math::" };

/// The number of instructions in all programs.
pub(crate) fn instructions(schedule: &Schedule) -> usize {
    let s = schedule;
    [&s.prepare, &s.rates, &s.rates_and_partials, &s.outputs, &s.outputs_and_partials, &s.by_input]
        .iter()
        .map(|p| p.instructions.len())
        .sum()
}

/// An expression of type `fdm::Model`. The files that the model uses are named from the folder of `Cargo.toml`; the program
/// holds their texts, and is built anew when they change.
pub(crate) fn model(schedule: &Schedule, text: &str, used: &[&str]) -> TokenStream {
    let sizes = Sizes::of(&schedule.layout);
    let programs = programs(schedule, &sizes);
    let dynamics = dynamics(&sizes);
    let build = build(&sizes);
    let used = used.iter().map(|name| match Path::new(name).is_absolute() {
        true => quote!(#name),
        false => quote!(::core::concat!(::core::env!("CARGO_MANIFEST_DIR"), "/", #name)),
    });
    // a module of its own: nothing in the scope of the user can be mistaken for a name of the generated code
    quote! {{
        #[allow(unused_variables, clippy::all, clippy::pedantic, clippy::nursery)]
        mod generated {
            #programs
            #dynamics
            #build
        }
        ::fdm::Model::with_code(
            ::core::concat!("model! at ", ::core::file!(), ":", ::core::line!()),
            #text,
            &[#(::core::include_str!(#used)),*],
            generated::build,
        )
    }}
}

/// Lengths of the arrays, as literals.
struct Sizes {
    states: Literal,
    drive: Literal,
    params: Literal,
    known: Literal,
    outputs: Literal,
    rate_slots: Literal,
    output_slots: Literal,
    input_slots: Literal,
}

impl Sizes {
    fn of(layout: &Layout) -> Self {
        let size = Literal::usize_unsuffixed;
        Self {
            states: size(layout.states),
            drive: size(layout.drive()),
            params: size(layout.params),
            known: size(layout.known),
            outputs: size(layout.outputs),
            rate_slots: size(layout.rate_slots()),
            output_slots: size(layout.output_slots()),
            input_slots: size(layout.input_slots()),
        }
    }
}

/// The six programs as functions.
fn programs(schedule: &Schedule, sizes: &Sizes) -> TokenStream {
    let Sizes { states, drive, params, known, outputs, rate_slots, output_slots, input_slots } = sizes;
    let prepare = body(&schedule.prepare);
    let functions = [
        ("rates", &schedule.rates, states),
        ("rates_and_partials", &schedule.rates_and_partials, rate_slots),
        ("outputs", &schedule.outputs, outputs),
        ("outputs_and_partials", &schedule.outputs_and_partials, output_slots),
        ("by_input", &schedule.by_input, input_slots),
    ];
    let functions = functions.into_iter().map(|(name, program, slots)| {
        let name = format_ident!("{name}");
        let body = body(program);
        let inline = if program.instructions.len() > MOST_COPIED { quote!(never) } else { quote!(always) };
        quote! {
            #[inline(#inline)]
            fn #name(
                t: f64,
                x: &[f64; #states],
                drive: &[f64; #drive],
                known: &[f64; #known],
                out: &mut [f64; #slots],
            ) {
                #body
            }
        }
    });
    quote! {
        fn prepare(known: &[f64; #params], out: &mut [f64; #known]) {
            #prepare
        }
        #(#functions)*
    }
}

/// A program as statements that write `out`, in the text that stand-alone Rust has too.
fn body(program: &Program) -> TokenStream {
    let place = |operand: Operand| match operand {
        Operand::Value(k) => format!("v{k}"),
        Operand::Constant(k) => NOTATION.number(program.constants[k as usize]),
        Operand::Time => "t".into(),
        Operand::State(k) => format!("x[{k}]"),
        Operand::Drive(k) => format!("drive[{k}]"),
        Operand::Known(k) => format!("known[{k}]"),
    };
    let mut lines = statements(&NOTATION, program, 0..program.instructions.len(), &place);
    lines.extend(program.results.iter().map(|r| format!("out[{}] = {};", r.slot, place(r.operand))));
    match lines.join("\n").parse() {
        Ok(tokens) => tokens,
        Err(_) => quote!(::core::compile_error!("generated code is no Rust, which is a fault of fdm");),
    }
}

/// The struct and its `Dynamics`.
fn dynamics(sizes: &Sizes) -> TokenStream {
    let Sizes { states, rate_slots, .. } = sizes;
    let bodies = ["rates", "rates_and_partials", "outputs", "outputs_and_partials", "by_input"].map(|name| {
        let name = format_ident!("{name}");
        quote! {
            #[inline]
            fn #name(&self, at: Point<'_>, out: &mut [f64], _: &mut Workspace) {
                #name(at.t, front(at.x), front(at.drive), front(at.known), front_mut(out));
            }
        }
    });
    quote! {
        use ::fdm::dynamics::{Dynamics, Layout, Point, Step, Workspace};
        use ::fdm::code::sized::{front, front_mut, runge_kutta, stages_of};

        struct Generated {
            layout: Layout,
        }

        impl Dynamics for Generated {
            fn layout(&self) -> &Layout {
                &self.layout
            }
            fn prepare(&self, theta: &[f64], known: &mut [f64], _: &mut Workspace) {
                prepare(front(theta), front_mut(known));
            }
            #(#bodies)*
            fn step(&self, step: Step<'_>, next: &mut [f64], _: &mut Workspace) {
                let mut slopes = [[0.0; #states]; 4];
                runge_kutta(step, front_mut(next), slopes.each_mut(), rates);
            }
            fn step_with_partials(&self, step: Step<'_>, next: &mut [f64], stages: &mut [f64], _: &mut Workspace) {
                runge_kutta(step, front_mut(next), stages_of::<#rate_slots>(stages), rates_and_partials);
            }
        }
    }
}

/// The constructor; its check can fail only where macro and library were built from different sources.
fn build(sizes: &Sizes) -> TokenStream {
    let Sizes { states, drive, params, known, outputs, rate_slots, output_slots, input_slots } = sizes;
    quote! {
        pub(super) fn build(layout: Layout) -> ::std::boxed::Box<dyn Dynamics> {
            let sizes = [
                layout.states,
                layout.drive(),
                layout.params,
                layout.known,
                layout.outputs,
                layout.rate_slots(),
                layout.output_slots(),
                layout.input_slots(),
            ];
            let generated = [
                #states, #drive, #params, #known, #outputs, #rate_slots, #output_slots, #input_slots
            ];
            ::core::assert!(sizes == generated, "fdm and fdm-macros are of different versions: a fault of the build");
            ::std::boxed::Box::new(Generated { layout })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fdm_grammar::op::Op;
    use fdm_grammar::schedule::{Instruction, Placed};

    fn printed(constants: &[f64], instructions: &[(Op, [Operand; 3])], results: &[Operand]) -> String {
        let instructions = instructions.iter().map(|(op, args)| Instruction { op: *op, args: *args }).collect();
        let placed = |(slot, operand): (usize, &Operand)| Placed { slot: slot as u32, operand: *operand };
        let (results, width) = (results.iter().enumerate().map(placed).collect(), results.len());
        body(&Program { constants: constants.to_vec(), instructions, calls: Vec::new(), results, width }).to_string()
    }

    #[test]
    fn a_program_is_one_let_for_each_instruction() {
        use Operand::{Constant, Drive, Known, State, Time, Value};
        let text = printed(
            &[2.0],
            &[
                (Op::Neg, [State(1); 3]),
                (Op::Mul, [Value(0), Constant(0), Value(0)]),
                (Op::Select, [Value(1), Drive(0), Known(4)]),
            ],
            &[Value(2), Time],
        );
        let wanted = "let v0 = - x [1] ; let v1 = v0 * 2.0 ; \
                      let v2 = :: fdm :: math :: select (v1 , drive [0] , known [4]) ; out [0] = v2 ; out [1] = t ;";
        assert_eq!(text, wanted);
    }

    #[test]
    fn every_operation_of_the_table_is_rust() {
        for row in fdm_grammar::op::ROWS.iter().filter(|row| row.form != fdm_grammar::op::Form::External) {
            let text = printed(&[], &[(row.op, [Operand::State(0), Operand::State(1), Operand::Time])], &[]);
            let block: syn::Block = syn::parse_str(&format!("{{ {text} }}")).expect(row.name);
            assert_eq!(block.stmts.len(), 1, "{}", row.name);
        }
    }
}
