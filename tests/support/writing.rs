//! Every way in which the command writes files, each in two variants, so that it can be seen whether a place holds the one or the
//! other, whole: under faults of the disk and under kills at random moments.

use crate::command::{Desk, said};
use std::collections::BTreeMap;
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};
use std::{fs, thread};

const MODEL: &str = "model decay \"first order\" {
  input u;
  state x = free;
  param k = 1 in [0, 50] [1/s], g = 1 in [-10, 10];
  der(x) = -k*x + g*u;
  output y = x;
}
";
const UGLY: &str = "model ugly { param   a=1;output y  = a; }\n";
/// Files that nobody but their owner may touch.
const STRANGERS: [&str; 4] = ["notes.txt", "result/notes.txt", "result/.own", "study/run.csv"];

/// A command line that writes; `@` stands for the variant.
pub struct Form {
    pub name: &'static str,
    words: &'static str,
    /// Files that it writes.
    files: &'static [&'static str],
    /// Folders with results that it writes.
    folders: &'static [&'static str],
    /// Files that are put back before each time: what they hold, or nothing where they are not to stand there.
    before: &'static [(&'static str, Option<&'static str>)],
    /// It takes seconds.
    pub is_slow: bool,
}

const fn form(
    name: &'static str,
    words: &'static str,
    files: &'static [&'static str],
    folders: &'static [&'static str],
) -> Form {
    Form { name, words, files, folders, before: &[], is_slow: false }
}

/// All verbs that write, with all options by which they do.
pub const FORMS: [Form; 17] = [
    form("simulate -o", "simulate model.fdm --data one.csv --set k=1.@ -o out.csv", &["out.csv"], &[]),
    form(
        "fit --out --plot --report --checkpoint",
        "fit model.fdm --data one.csv --set k=1.@ --starts 3 -q --out result --plot fit.svg --report fit.html --checkpoint kept@",
        &["fit.svg", "fit.html"],
        &["result"],
    ),
    form(
        "study --out --checkpoint",
        "study model.fdm --data one.csv --set k=1.@ --repeats 6 -q --out study --checkpoint studied@",
        &[],
        &["study"],
    ),
    form(
        "validate --out",
        "validate --from-result base1 --data two.csv --steps @ -q --out valid --report valid.html",
        &["valid.html"],
        &["valid"],
    ),
    form("regress --out", "regress model.fdm --data one.csv --set k=1.@ -q --out rates", &[], &["rates"]),
    form(
        "regress --recursive --plot",
        "regress model.fdm --data one.csv --recursive --forgetting 0.9@ -q --plot rates.svg",
        &["rates.svg"],
        &[],
    ),
    Form {
        name: "diagnose --out --report",
        words: "diagnose model.fdm --data one.csv --set k=1.@ --only constant_force --max-effects 0 -q --out causes --report causes.html",
        files: &["causes.html"],
        folders: &["causes"],
        before: &[],
        is_slow: true,
    },
    form(
        "profile --plot",
        "profile model.fdm --data one.csv --parameter g --fix k --set k=2.0@ -q --plot profile.svg",
        &["profile.svg"],
        &[],
    ),
    form(
        "spectra --plot",
        "spectra model.fdm --data one.csv --overlap 0.@ -q --plot spectra.svg",
        &["spectra.svg"],
        &[],
    ),
    form(
        "design --records",
        "design --from-result base1 --data one.csv --amplitude u=@ --runs 1 -q --records planned --force",
        &["planned/run_1.csv"],
        &[],
    ),
    form("report -o", "report base@ -o page.html", &["page.html"], &[]),
    form("plot -o", "plot base@ --figure residual-spectrum-1 -o figure.svg", &["figure.svg"], &[]),
    form(
        "extend --write",
        "extend model.fdm --effect input_delay(u) --step 0.0@ --write extended.fdm --force",
        &["extended.fdm"],
        &[],
    ),
    form("export -o", "export model.fdm --to c --set k=1.@ -o model.c", &["model.c"], &[]),
    form("man", "man manual", &["manual/fdm.1", "manual/fdm-fit.1"], &[]),
    Form {
        name: "fmt",
        words: "fmt ugly.fdm",
        files: &["ugly.fdm"],
        folders: &[],
        before: &[("ugly.fdm", Some(UGLY))],
        is_slow: false,
    },
    Form {
        name: "new",
        words: "new first.fdm",
        files: &["first.fdm", "first.csv"],
        folders: &[],
        before: &[("first.fdm", None), ("first.csv", None)],
        is_slow: false,
    },
];

/// The contents of every place that a form writes: of a file, or of all files of a folder; none where nothing stands.
type Snapshot = BTreeMap<&'static str, Option<Vec<(String, Vec<u8>)>>>;

/// A folder in which all forms have been run once in both variants.
pub struct Table {
    desk: Desk,
    written: Vec<[Snapshot; 2]>,
    names: Vec<String>,
    lasts: Vec<Duration>,
}

impl Form {
    /// Whether it writes dozens of files.
    pub fn is_of_many(&self) -> bool {
        !self.folders.is_empty() || self.name == "man"
    }

    fn words(&self, variant: usize) -> String {
        self.words.replace('@', &(variant + 1).to_string())
    }

    fn put_back(&self, desk: &Desk) {
        for (name, content) in self.before {
            match content {
                Some(content) => drop(desk.write(name, content)),
                None => drop(fs::remove_file(desk.path(name))),
            }
        }
    }

    fn snapshot(&self, desk: &Desk) -> Snapshot {
        let file =
            |name: &&'static str| (*name, fs::read(desk.path(name)).ok().map(|content| vec![(String::new(), content)]));
        let folder = |name: &&'static str| (*name, fdm_results::store::whole_files(&desk.path(name)).ok());
        self.files.iter().map(file).chain(self.folders.iter().map(folder)).collect()
    }
}

impl Table {
    /// Runs all forms whole, in both variants.
    ///
    /// # Panics
    /// When one of them fails.
    #[expect(clippy::new_without_default, reason = "it takes seconds")]
    pub fn new() -> Self {
        let desk = Desk::with([("model.fdm", MODEL), ("ugly.fdm", UGLY)]);
        for (name, start) in [("one.csv", 1.0), ("two.csv", -0.5)] {
            desk.write(name, record(start));
        }
        for folder in ["result", "study", "planned"] {
            fs::create_dir(desk.path(folder)).unwrap();
        }
        STRANGERS.iter().for_each(|name| drop(desk.write(name, format!("{name} is mine"))));
        for base in ["base1", "base2"] {
            desk.good(&format!("fit model.fdm --data one.csv --set k=1.{} -q --out {base}", &base[4..]));
        }
        let (mut written, mut lasts) = (Vec::new(), Vec::new());
        for form in &FORMS {
            let begun = Instant::now();
            written.push([0, 1].map(|variant| {
                form.put_back(&desk);
                let output = desk.fdm(&form.words(variant));
                assert_eq!(output.status.code(), Some(0), "{}: {}", form.name, said(&output));
                let found = form.snapshot(&desk);
                assert!(found.values().all(Option::is_some), "{}: {:?}", form.name, found.keys());
                found
            }));
            lasts.push(begun.elapsed() / 2);
        }
        let names = all_names(&desk);
        Self { desk, written, names, lasts }
    }

    /// Every place holds one variant or the other, whole (or what stood there before, where that is put back), and files of others are
    /// what they were.
    fn check(&self, form: usize, context: &str) {
        let found = FORMS[form].snapshot(&self.desk);
        for (place, content) in &found {
            let put_back = FORMS[form].before.iter().find(|(name, _)| name == place);
            let before = put_back.map(|(_, c)| c.map(|c| vec![(String::new(), c.as_bytes().to_vec())]));
            let whole = self.written[form].iter().any(|w| w[place] == *content) || before.as_ref() == Some(content);
            assert!(whole, "{}: {place} is not whole after {context}", FORMS[form].name);
        }
        for name in STRANGERS {
            assert_eq!(self.desk.text(name), format!("{name} is mine"), "{}: after {context}", FORMS[form].name);
        }
    }

    /// Runs a form to its end: it gives what it gave without an interruption, to the bit.
    ///
    /// # Panics
    /// When it does not.
    pub fn complete(&self, form: usize) {
        for variant in [0, 1] {
            FORMS[form].put_back(&self.desk);
            let output = self.desk.fdm(&FORMS[form].words(variant));
            let name = FORMS[form].name;
            assert_eq!(output.status.code(), Some(0), "{name}: {}", said(&output));
            assert!(FORMS[form].snapshot(&self.desk) == self.written[form][variant], "{name}: another result");
        }
    }

    /// Runs all forms to their ends.
    fn complete_all(&self) {
        (0..FORMS.len()).for_each(|form| self.complete(form));
        assert_eq!(all_names(&self.desk), self.names, "nothing is left of what was interrupted");
    }

    fn begin_anew(&self, variant: usize) {
        for kept in ["kept", "studied"] {
            let _ = fs::remove_dir_all(self.desk.path(&format!("{kept}{}", variant + 1)));
        }
    }

    /// Lets the n-th operation on files fail; whether there was one.
    fn faulty(&self, form: usize, kind: &str, n: usize) -> Option<Output> {
        let variant = n % 2;
        FORMS[form].put_back(&self.desk);
        self.begin_anew(variant);
        let mut command = self.desk.command(&FORMS[form].words(variant));
        let output = command.env("FDM_FAULT", format!("{kind}:{n}")).output().unwrap();
        said(&output).contains("fault at operation").then_some(output)
    }

    /// Lets every `stride`-th operation on files fail in this way, one after the other; says how many there were.
    ///
    /// # Panics
    /// When anything is lost.
    pub fn faults(&self, form: usize, kind: &str, stride: usize) -> usize {
        let mut count = 0;
        let mut n = 0;
        while let Some(output) = self.faulty(form, kind, n) {
            let context = format!("{kind} at operation {n}: {}", said(&output));
            self.check(form, &context);
            match output.status.code() {
                Some(86) => assert!(kind.starts_with("dies"), "{context}"),
                // something was tried again, or needed no more
                Some(0) => {}
                Some(1 | 2) => assert!(context.contains("the disk is full"), "{context}"),
                _ => panic!("{}: {context}", FORMS[form].name),
            }
            count += 1;
            n += stride;
        }
        self.complete(form);
        assert_eq!(all_names(&self.desk), self.names, "{}", FORMS[form].name);
        count
    }

    /// Kills commands at random moments, one form after the other; says how many were alive.
    ///
    /// # Panics
    /// When anything is lost.
    pub fn kills(&self, count: usize, seed: u64) -> BTreeMap<&'static str, usize> {
        let mut random = fdm_numeric::random::SplitMix(seed);
        let mut killed = BTreeMap::new();
        let mut tries = 0;
        while killed.values().sum::<usize>() < count && tries < 10 * count {
            let form = tries % FORMS.len();
            let round = tries / FORMS.len();
            tries += 1;
            // what takes long takes its turn less often
            if FORMS[form].is_slow && round % 10 != 9 {
                continue;
            }
            let variant = round % 2;
            FORMS[form].put_back(&self.desk);
            let mut command = self.desk.command(&FORMS[form].words(variant));
            let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
            let moment = self.lasts[form].mul_f64(1.1 * random.uniform());
            thread::sleep(moment);
            let alive = child.try_wait().unwrap().is_none();
            child.kill().unwrap();
            child.wait().unwrap();
            self.check(form, &format!("a kill after {moment:.1?} (try {tries})"));
            *killed.entry(FORMS[form].name).or_insert(0) += usize::from(alive);
            // a complete checkpoint has nothing left to do
            if !alive || random.uniform() < 0.2 {
                self.begin_anew(variant);
            }
            if tries % (50 * FORMS.len()) == 0 {
                self.tell(&killed);
                self.complete_all();
            }
        }
        self.complete_all();
        killed
    }

    /// How far kills are, for whoever waits for them.
    fn tell(&self, killed: &BTreeMap<&str, usize>) {
        if let Some(file) = std::env::var_os("FDM_KILLS_LOG") {
            let _ = fs::write(file, format!("{} kills: {killed:?}\n", killed.values().sum::<usize>()));
        }
    }
}

/// x' = -2 x + 3 u under a held square wave, with a ripple that stands for noise.
fn record(start: f64) -> String {
    let (k, g, dt) = (2.0, 3.0, 0.05);
    let mut x: f64 = start;
    let mut rows = String::from("t [s],u,y\n");
    for n in 0..120 {
        let u = if (0.11 * f64::from(n)).sin() > 0.0 { 1.0 } else { -1.0 };
        let ripple = 0.01 * (f64::from(n * n) * 0.7).sin();
        rows.push_str(&format!("{},{u},{}\n", dt * f64::from(n), x + ripple));
        x = (x - g / k * u) * (-k * dt).exp() + g / k * u;
    }
    rows
}

/// Everything below a desk but what checkpoints keep.
fn all_names(desk: &Desk) -> Vec<String> {
    let mut names = Vec::new();
    for name in desk.names("") {
        if name.starts_with("kept") || name.starts_with("studied") {
            continue;
        }
        if desk.path(&name).is_dir() {
            names.extend(desk.names(&name).iter().map(|inner| format!("{name}/{inner}")));
        }
        names.push(name);
    }
    names
}
