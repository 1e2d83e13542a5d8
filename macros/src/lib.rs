//! The macro `model!`: an fdm model compiled with the Rust program that holds it.
//!
//! **In** the tokens of a model. **Out** an expression of type `fdm::Model` whose numbers come from Rust code, or one
//! `compile_error!` for each mistake, at its token. **Never** a grammar of its own: the tokens become text again.
//! **Start** at [`model`]. It is documented where it is used, as `fdm::model!`.

mod emit;
mod files;
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
    let mut source = Source::new("model!", &*written.text);
    files::gather(&mut source);
    let compiled = match fdm_grammar::compile(&source) {
        Ok(compiled) => compiled,
        Err(mistakes) => {
            let mistakes = mistakes.iter().filter(|d| d.is_error());
            return refusal(
                mistakes.map(|d| error(written.tokens(files::own(&source, d.span)), &message(d, &written, &source))),
            );
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
    if compiled.model.has_events() {
        let message = "model! does not know events (`when`)\n\
                       hint: put the model into a .fdm file and load it with fdm::Model::from_file";
        return refusal([error((Span::call_site(), Span::call_site()), message)].into_iter());
    }
    let used: Vec<&str> = source.texts()[1..].iter().map(|t| t.name()).collect();
    emit::model(&compiled.schedule, &written.text, &used)
}

/// The sentence, its code, other places and the hint; what stands in a used file is told with its place there.
fn message(mistake: &Diagnostic, written: &ModelText, source: &Source) -> String {
    let place = |span: fdm_grammar::Span| {
        let (text, at) = (source.text_at(span.start), source.position(span.start));
        match text.used_at() {
            Some(_) => format!("{}:{}:{}", text.name(), at.line, at.column),
            None => format!("line {}", written.tokens(span).0.start().line),
        }
    };
    let mut message = format!("{} [{}]", mistake.message, mistake.code.text());
    if files::own(source, mistake.span) != mistake.span {
        message = format!("{}: {message}", place(mistake.span));
    }
    for label in &mistake.labels {
        message += &format!("\n{}: {}", place(label.span), label.text);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proc_macro2::TokenTree;
    use std::str::FromStr;

    fn expanded(model: &str) -> TokenStream {
        expand(TokenStream::from_str(model).expect("tokens"))
    }

    fn words(tokens: TokenStream, found: &mut Vec<String>) {
        for tree in tokens {
            match tree {
                TokenTree::Group(group) => words(group.stream(), found),
                TokenTree::Ident(ident) => found.push(ident.to_string()),
                _ => {}
            }
        }
    }

    #[test]
    fn a_model_becomes_a_block_without_names_of_the_user() {
        let tokens = expanded(
            "model foo { input bar; state baz = qux; param qux = 1, quux = 2; der(baz) = delay(bar, quux) - baz;
             output corge = sin(baz); }",
        );
        assert!(syn::parse2::<syn::ExprBlock>(tokens.clone()).is_ok(), "{tokens}");
        let mut found = Vec::new();
        words(tokens, &mut found);
        assert!(found.iter().any(|w| w == "sin"));
        let leaked = ["foo", "bar", "baz", "qux", "quux", "corge"].into_iter().find(|n| found.iter().any(|w| w == n));
        assert_eq!(leaked, None);
    }

    #[test]
    fn a_refused_model_is_an_expression_with_all_errors() {
        let tokens = expanded("model a { state x; der(x) = y; output z = w; }");
        assert!(syn::parse2::<syn::ExprBlock>(tokens.clone()).is_ok(), "{tokens}");
        let text = tokens.to_string();
        assert_eq!((text.matches("compile_error").count(), text.matches("[E0201]").count()), (2, 2), "{text}");
    }

    #[test]
    fn a_model_too_long_for_rustc_is_sent_to_a_file() {
        let terms: String = (1..=emit::MOST_INSTRUCTIONS).map(|k| format!(" + sin({k}*x)")).collect();
        let tokens = expanded(&format!("model a {{ input x; output y = 0{terms}; }}"));
        let text = tokens.to_string();
        assert!(text.contains("model! hands to rustc") && text.contains("from_file"), "{}", &text[..200]);
    }
}
