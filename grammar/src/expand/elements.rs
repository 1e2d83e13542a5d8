//! What later rooms say about every element of a vector, said once about the vector.

use crate::diagnostic::{Code, Diagnostic};
use crate::source::Span;
use std::collections::HashMap;

/// The vectors and matrices of a model, by the place of their name.
#[derive(Debug, Default, Clone)]
pub struct Elements {
    declared: HashMap<Span, (String, usize)>,
}

impl Elements {
    /// A name with so many elements that are not 0 by structure.
    pub(super) fn add(&mut self, place: Span, name: &str, count: usize) {
        self.declared.insert(place, (name.into(), count));
    }

    /// One finding for a mistake that all elements make; what nothing uses is told when no element is used.
    pub fn told(&self, findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
        if self.declared.is_empty() {
            return findings;
        }
        let mut counts: HashMap<(Code, Span), usize> = HashMap::new();
        for finding in &findings {
            *counts.entry((finding.code, finding.span)).or_default() += 1;
        }
        let mut seen: HashMap<(Code, Span), ()> = HashMap::new();
        let mut told = Vec::with_capacity(findings.len());
        for mut finding in findings {
            let key = (finding.code, finding.span);
            let first = seen.insert(key, ()).is_none();
            if let Some((name, count)) = self.declared.get(&finding.span) {
                let all = counts[&key] >= *count;
                match finding.code {
                    Code::Unused if !all => continue,
                    Code::NoInfluence if !all => {}
                    _ if !first => continue,
                    // one unit is declared for all
                    Code::UnitUnknown => of_all(&mut finding, name),
                    _ if all => of_all(&mut finding, name),
                    _ => {}
                }
            } else if !first {
                continue;
            }
            told.push(finding);
        }
        told
    }
}

/// Says of `x` what was said of `x[1]`.
fn of_all(finding: &mut Diagnostic, name: &str) {
    let start = format!("{name}[");
    for text in [Some(&mut finding.message), finding.hint.as_mut()].into_iter().flatten() {
        let mut rest = std::mem::take(text);
        while let Some(at) = rest.find(&start) {
            let index = at + name.len();
            let Some(end) = rest[index..].find(']') else { break };
            text.push_str(&rest[..index]);
            rest.replace_range(..=index + end, "");
        }
        text.push_str(&rest);
    }
}
