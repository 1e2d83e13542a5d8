//! What each package may hold: lines, files, constants and long functions, by the rows of `budget.csv`. A row only falls, unless the
//! commit that raises it says why.

use crate::cycles;
use crate::sources::{code_of, packages_below, product};
use fancy_regex::Regex;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use support::files;

/// A longer function does more than one thing.
const LONGEST: usize = 100;

/// Functions that are one table, by package, file and name: cut in pieces they would be read no easier.
const TABLES: [(&str, &str, &str); 2] = [
    // an arm for each kind of model that `fdm new` knows
    ("cli", "new.rs", "recipe"),
    // an arm for each operation of the program, written out for the lanes of one set of instructions
    ("system", "frequency/program.rs", "with_simd"),
];

/// A row of the table.
#[derive(Default, Clone, Copy, PartialEq)]
struct Row {
    lines: usize,
    files: usize,
    constants: usize,
    long: usize,
}

const COLUMNS: [&str; 4] = ["lines", "files", "constants", "long functions"];

impl Row {
    fn cells(self) -> [usize; 4] {
        [self.lines, self.files, self.constants, self.long]
    }

    fn separated(self, by: &str) -> String {
        self.cells().map(|n| n.to_string()).join(by)
    }

    fn add(&mut self, other: Self) {
        self.lines += other.lines;
        self.files += other.files;
        self.constants += other.constants;
        self.long += other.long;
    }
}

/// The project, or the folder of another state of it that `FDM_HOUSE` names.
fn root() -> PathBuf {
    std::env::var_os("FDM_HOUSE").map_or_else(|| support::repository().to_path_buf(), PathBuf::from)
}

/// The functions of a text with their lengths. The formatter closes each at its own depth.
fn functions(code: &str) -> Vec<(String, usize)> {
    static HEAD: LazyLock<Regex> =
        LazyLock::new(|| Regex::new(r#"^( *)(?:pub(?:\([^)]*\))? )?(?:const |unsafe |extern "C" )*fn (\w+)"#).unwrap());
    let lines: Vec<&str> = code.lines().map(str::trim_end).collect();
    let mut found = Vec::new();
    for (k, line) in lines.iter().enumerate() {
        let Some(captures) = HEAD.captures(*line).unwrap() else { continue };
        let end = format!("{}}}", &captures[1]);
        let one_line = line.ends_with(';') || line.ends_with('}');
        let length = if one_line { 1 } else { lines[k..].iter().take_while(|l| **l != end).count() + 1 };
        found.push((captures[2].to_string(), length));
    }
    found
}

/// The row of a package and its long functions, each with its place.
fn counted(name: &str, sources: &[(PathBuf, String)]) -> (Row, Vec<String>) {
    let constant = Regex::new(r"\bconst \w+: (?:f64|f32|[iu](?:8|16|32|64|128|size)) =").unwrap();
    let mut row = Row { files: sources.len(), ..Row::default() };
    let mut long = Vec::new();
    for (path, code) in sources {
        row.lines += code.lines().filter(|line| !line.trim().is_empty()).count();
        row.constants += constant.find_iter(code).count();
        let table = |function: &str| TABLES.contains(&(name, &path.to_string_lossy(), function));
        for (function, length) in functions(code).into_iter().filter(|(f, n)| *n > LONGEST && !table(f)) {
            long.push(format!("{name}/{}: {function}, {length} lines", path.display()));
        }
    }
    row.long = long.len();
    (row, long)
}

/// The rows of all that a user builds, and the long functions.
fn measured(root: &Path) -> (BTreeMap<String, Row>, Vec<String>) {
    let mut sources: Vec<(String, Vec<(PathBuf, String)>)> =
        packages_below(root).into_iter().map(|(name, folder)| (name, product(&folder))).collect();
    sources.push(("python".into(), product(&root.join("python/src"))));
    sources.push((
        "facade".into(),
        ["lib.rs", "main.rs", "example.rs", "build.rs"]
            .map(PathBuf::from)
            .into_iter()
            .filter_map(|file| Some((file.clone(), code_of(&fs::read_to_string(root.join("src").join(file)).ok()?))))
            .collect(),
    ));
    let (mut rows, mut long) = (BTreeMap::new(), Vec::new());
    for (name, sources) in sources {
        let (row, functions) = counted(&name, &sources);
        rows.insert(name, row);
        long.extend(functions);
    }
    (rows, long)
}

fn table() -> PathBuf {
    support::repository().join("tests/house/budget.csv")
}

fn allowed() -> BTreeMap<String, Row> {
    let text = fs::read_to_string(table()).unwrap();
    let row = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let [lines, files, constants, long] = [1, 2, 3, 4].map(|k| cells[k].parse().unwrap());
        (cells[0].to_string(), Row { lines, files, constants, long })
    };
    text.lines().skip(1).map(row).collect()
}

fn words(folder: &Path) -> usize {
    let texts = files(&folder.to_string_lossy(), "md");
    texts.iter().map(|file| fs::read_to_string(file).unwrap().split_whitespace().count()).sum()
}

/// The figures of the whole beside what they are to become.
fn whole(root: &Path, rows: &BTreeMap<String, Row>, long: &[String]) -> String {
    let mut sum = Row::default();
    rows.values().for_each(|row| sum.add(*row));
    let circles: Vec<usize> =
        packages_below(root).iter().flat_map(|(_, folder)| cycles::large(folder)).map(|c| c.len()).collect();
    let manual: usize = ["guide", "reference", "theory"].iter().map(|f| words(&root.join("docs").join(f))).sum();
    let binary = fs::metadata(root.join("target/release/fdm")).map_or(0, |file| file.len());
    let figures = [
        ("lines of code", sum.lines.to_string(), "110000"),
        ("product files", sum.files.to_string(), "620"),
        ("files in import cycles of more than three", circles.iter().sum::<usize>().to_string(), "0"),
        ("functions above 100 lines, without tables", sum.long.to_string(), "0"),
        ("named numeric constants", sum.constants.to_string(), "800"),
        ("... in what chooses models (infer)", rows.get("infer").map_or(0, |r| r.constants).to_string(), "40"),
        ("words of guide, reference, theory", manual.to_string(), "55000"),
        ("words of notebook", words(&root.join("docs/notebook")).to_string(), "10000"),
        ("size of target/release/fdm, if built, MB", format!("{:.1}", binary as f64 / 1e6), "18"),
    ];
    let mut text = String::from("| | is | aim, at most |\n|---|---:|---:|\n");
    figures.iter().for_each(|(what, is, aim)| writeln!(text, "| {what} | {is} | {aim} |").unwrap());
    writeln!(text, "\n| package | {} |\n|---|---:|---:|---:|---:|", COLUMNS.join(" | ")).unwrap();
    for (name, row) in rows {
        writeln!(text, "| {name} | {} |", row.separated(" | ")).unwrap();
    }
    long.iter().for_each(|place| writeln!(text, "\n{place}").unwrap());
    text
}

#[test]
fn packages_keep_to_their_budgets() {
    let root = root();
    let (rows, long) = measured(&root);
    println!("{}", whole(&root, &rows, &long));
    if root != support::repository() {
        return;
    }
    if std::env::var_os("FDM_BLESS").is_some() {
        let mut text = format!("package,{}\n", COLUMNS.join(","));
        for (name, row) in &rows {
            writeln!(text, "{name},{}", row.separated(",")).unwrap();
        }
        fs::write(table(), text).unwrap();
        return;
    }
    let allowed = allowed();
    let mut grown = String::new();
    for (name, row) in &rows {
        let most = allowed.get(name).copied().unwrap_or_default();
        for ((column, is), may) in COLUMNS.iter().zip(row.cells()).zip(most.cells()).filter(|((_, is), may)| is > may) {
            writeln!(grown, "{name}: {is} {column}, the budget is {may}").unwrap();
        }
    }
    assert!(
        grown.is_empty(),
        "{grown}{}\nCut it, or raise the row of tests/house/budget.csv (`FDM_BLESS=1 cargo test -p fdm-tests --test house budget`) \
         in a commit that says why.",
        long.join("\n")
    );
}

#[test]
fn functions_are_measured_to_their_ends() {
    let code = "impl A {\n    pub(crate) fn long(\n        a: u8,\n    ) {\n        if a {\n        }\n    }\n    fn declared();\n}\nfn short() {}\n";
    let expected = [("long".to_string(), 6), ("declared".to_string(), 1), ("short".to_string(), 1)];
    assert_eq!(functions(code), expected);
}
