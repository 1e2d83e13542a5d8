//! Effects on small models.

use super::*;
use crate::{Source, compile};

#[test]
fn look() {
    let (catalogue, findings) = Catalogue::read(&Source::new("effects.fdm", STANDARD));
    let source = Source::new("effects.fdm", STANDARD);
    for f in &findings {
        println!("{}", f.line(&source));
    }
    let text = std::fs::read_to_string("../models/pendulum_free_swing/driven.fdm").unwrap();
    let source = Source::new("m.fdm", text);
    let base = compile(&source).unwrap();
    let subject = Subject::new(&source, &base.model).unwrap();
    let mut last = String::new();
    for c in catalogue.places(&subject).candidates {
        let e = match c.apply(&subject, &Nominal, &Choice::new()) {
            Ok(e) => e,
            Err(d) => {
                println!("{c}: {}", d.message);
                continue;
            }
        };
        let compiled = match e.compile() {
            Ok(c) => c,
            Err(f) => {
                println!("{c}: {}\n{}", f.iter().map(|f| f.line(e.source())).collect::<Vec<_>>().join("\n"), e.text());
                continue;
            }
        };
        let w: Vec<_> = compiled.warnings.iter().map(|f| f.line(e.source())).collect();
        println!("{c}: {:?} {w:?}", e.null(&compiled.model));
        if c.effect().name() != last {
            last = c.effect().name().into();
            for line in e.text().lines().filter(|l| !source.text().contains(*l)) {
                println!("    {line}");
            }
        }
    }
}
