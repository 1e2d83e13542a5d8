use std::path::Path;
fn main() {
    let mut a = std::env::args().skip(1);
    let (from, to) = (a.next().unwrap(), a.next().unwrap());
    match fdm_petab::import(Path::new(&from)) {
        Ok(i) => {
            let f = Path::new(&to);
            std::fs::create_dir_all(f.join("runs")).unwrap();
            for (n, t) in [("model.fdm", &i.model), ("runs.csv", &i.table), ("fdm.toml", &i.project), ("IMPORT.md", &i.report)] {
                std::fs::write(f.join(n), t).unwrap();
            }
            for r in &i.runs { std::fs::write(f.join(&r.path), &r.text).unwrap(); }
            std::fs::write(f.join("constant"), format!("{}", i.constant)).unwrap();
        }
        Err(e) => { for e in e { println!("{e}"); } std::process::exit(2) }
    }
}
