//! The macro `model!`: an fdm model compiled with the Rust program that holds it.
//!
//! **In** the tokens of a model. **Out** an expression of type `fdm::Model` whose numbers come from Rust code, or one
//! `compile_error!` for each mistake, at its token. **Never** a grammar of its own: the tokens become text again.
//! **Start** at [`model`]. It is documented where it is used, as `fdm::model!`.

mod emit;
mod text;

use fdm_grammar::{Diagnostic, Source};
use proc_macro2::{Span, TokenStream};
use quote::{quote, quote_spanned};
use text::ModelText;

/// A model of the fdm language as an expression of type `fdm::Model`.
#[proc_macro]
pub fn model(tokens: proc_macro::TokenStream) -> proc_macro::TokenStream {
    expand(tokens.into()).into()
}

fn expand(tokens: TokenStream) -> TokenStream {
    let written = match ModelText::new(tokens) {
        Ok(written) => written,
        Err(foreign) => return refusal(foreign.iter().map(|f| error((f.span, f.span), &f.message))),
    };
    let source = Source::new("model!", &*written.text);
    let compiled = match fdm_grammar::compile(&source) {
        Ok(compiled) => compiled,
        Err(mistakes) => {
            let mistakes = mistakes.iter().filter(|d| d.is_error());
            return refusal(mistakes.map(|d| error(written.tokens(d.span), &message(d, &written))));
        }
    };
    let count = emit::instructions(&compiled.schedule);
    if count > emit::MOST_INSTRUCTIONS {
        let most = emit::MOST_INSTRUCTIONS;
        let message = format!(
            "this model needs {count} instructions, more than the {most} that model! hands to rustc\n\
             hint: put it into a .fdm file and load it with fdm::Model::from_file, which compiles it much faster"
        );
        return refusal([error((Span::call_site(), Span::call_site()), &message)].into_iter());
    }
    emit::model(&compiled.schedule, &written.text)
}

/// The sentence, its code, other places and the hint.
fn message(mistake: &Diagnostic, written: &ModelText) -> String {
    let mut message = format!("{} [{}]", mistake.message, mistake.code.text());
    for label in &mistake.labels {
        let line = written.tokens(label.span).0.start().line;
        message += &format!("\nline {line}: {}", label.text);
    }
    if let Some(hint) = &mistake.hint {
        message += &format!("\nhint: {hint}");
    }
    message
}

/// One `compile_error!` that rustc shows from the first to the last token: it joins the places of the macro's name
/// and of its argument, which a macro may not do itself in stable Rust.
fn error((first, last): (Span, Span), message: &str) -> TokenStream {
    let name = quote_spanned!(first=> ::core::compile_error!);
    let argument = quote_spanned!(last=> { #message });
    quote!(#name #argument)
}

/// All errors in an expression that still has the right type, so that no error follows from them.
fn refusal(errors: impl Iterator<Item = TokenStream>) -> TokenStream {
    let mut errors: Vec<TokenStream> = errors.collect();
    if errors.is_empty() {
        let nowhere = (Span::call_site(), Span::call_site());
        errors.push(error(nowhere, "this model is refused and no mistake was named, which is a fault of fdm"));
    }
    quote! {{
        #(#errors)*
        fn model() -> ::fdm::Model {
            loop {}
        }
        model()
    }}
}
