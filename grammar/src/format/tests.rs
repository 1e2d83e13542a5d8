//! What the layout promises: nothing but spaces changes, a second time nothing at all, and good texts hardly.

use super::*;
use proptest::prelude::*;
use std::fs;
use std::path::{Path, PathBuf};

fn formatted(text: &str) -> String {
    match format(&Source::new("t.fdm", text)) {
        Ok(text) => text,
        Err(Refusal::Mistakes(findings)) => panic!("{findings:#?}\n{text}"),
        Err(Refusal::Meaning) => {
            let after = layout(text);
            let split = |t| -> (Vec<_>, Vec<_>) { lines::pieces(t).into_iter().partition(Piece::is_comment) };
            let ((a, b), (c, d)) = (split(text), split(&after));
            let differ = |a: &[Piece<'_>], b: &[Piece<'_>]| {
                let pair = a.iter().zip(b).find(|(a, b)| word(a) != word(b));
                pair.map(|(a, b)| format!("{a:?} {b:?}"))
            };
            let changed = (a.len(), c.len(), differ(&a, &c), differ(&b, &d));
            panic!("the meaning changed: {changed:?}\n{text}\n---\n{after}")
        }
    }
}

fn models(folder: &Path, found: &mut Vec<PathBuf>) {
    for path in fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()) {
        if path.is_dir() && !path.ends_with("target") && !path.ends_with(".git") {
            models(&path, found);
        } else if path.extension().is_some_and(|e| e == "fdm") {
            found.push(path);
        }
    }
    found.sort();
}

/// The texts of all `.fdm` files of the repository, broken ones too.
fn texts() -> Vec<(PathBuf, String)> {
    let mut found = Vec::new();
    models(&Path::new(env!("CARGO_MANIFEST_DIR")).join(".."), &mut found);
    assert!(found.len() > 100, "the walk found the models");
    found.into_iter().filter_map(|p| fs::read_to_string(&p).ok().map(|text| (p, text))).collect()
}

#[test]
fn every_model_is_laid_out_and_a_second_time_unchanged() {
    let mut count = 0;
    for (path, text) in texts() {
        let source = Source::new("t.fdm", &*text);
        match format(&source) {
            Ok(once) => {
                assert_eq!(formatted(&once), once, "{}", path.display());
                count += 1;
            }
            Err(Refusal::Mistakes(findings)) => assert!(!findings.is_empty()),
            Err(Refusal::Meaning) => panic!("{}", path.display()),
        }
        // what is refused can be laid out too, and keeps its words
        assert!(same_words(&text, &layout(&text)), "{}:\n{}", path.display(), layout(&text));
    }
    assert!(count > 60, "{count} models");
}

const SCATTERED: &str = "\u{feff}// of  whom \r\n/* and\r\n   what */ model  m\"doc\"{ // begins\r\n\r\n\r\n
input u[m],ü [m]  ; state x[3]\"\" [m]=free,v [ 1 ]; time\t[min]; // unit of t
   param a=-1e-3*-2^-x1+ +3 in[-inf,5][m/s]fixed   \"a\", // one
     // between
     b = 2 // two
     ; ;
param long_a = 1 in [0, 1] [m/s], long_b = 2 in [0, 1] [m/s], long_c = 3 in [0, 1] [m/s], long_d = 4 in [0, 1] [m/s], e = 5;
param A[2,2]=[[1,2],[3,4]];let c = if not(a<=b)and x[2]>=A[1, :]then-a else /* why */ b;
table CL(alpha[rad])\"lift\"[1]=linear{-0.2:-0.9,
0:c0,0.3:1.6
};use\"actuator.fdm\"as act(x=dlon,T=T_act);
trim{x=1;v=a;}trim {
x = 2;
}
noise y=0.1;noise der( x1 )=q,der(x)=2*q;prior a~normal(0,1),x(0)~normal(1,2);tie Lq=Mp,a=2*b;
der(x) = (v + aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa*bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb + ccccccccccccccccccccccccccc/ddddddddddddddd - e*act.y)*2;
 der(x1)=u


;output y=x// end
;
}
// after
";

const LAID_OUT: &str = r#"// of  whom
/* and
   what */
model m "doc" {  // begins
  input u [m], ü [m];
  state x[3] "" [m] = free, v [ 1 ];
  time [min];                                                     // unit of t
  param a      = -1e-3*-2^-x1 + +3 in [-inf, 5] [m/s] fixed "a",  // one
        // between
        b      = 2;;  // two
  param long_a = 1 in [0, 1] [m/s], long_b = 2 in [0, 1] [m/s], long_c = 3 in [0, 1] [m/s], long_d = 4 in [0, 1] [m/s],
        e      = 5;
  param A[2,2] = [[1, 2], [3, 4]];
  let c = if not (a <= b) and x[2] >= A[1, :] then -a else /* why */ b;
  table CL(alpha [rad]) "lift" [1] = linear { -0.2: -0.9,
    0: c0, 0.3: 1.6
  };
  use "actuator.fdm" as act(x = dlon, T = T_act);
  trim { x = 1; v = a; }
  trim {
    x = 2;
  }
  noise y = 0.1;
  noise der(x1) = q, der(x) = 2*q;
  prior a ~ normal(0, 1), x(0) ~ normal(1, 2);
  tie Lq = Mp, a = 2*b;
  der(x)  = (v + aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa*bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb
    + ccccccccccccccccccccccccccc/ddddddddddddddd - e*act.y)*2;
  der(x1) = u;
  output y = x;  // end
}
// after
"#;

#[test]
fn a_scattered_text_is_put_in_order() {
    let once = formatted(SCATTERED);
    let text = once.strip_prefix('\u{feff}').expect("the mark stays");
    assert!(!text.replace("\r\n", "").contains(['\r', '\n']), "line ends are those of the first line");
    let unified = text.replace("\r\n", "\n");
    assert_eq!(unified, LAID_OUT, "\n{unified}");
    assert_eq!(formatted(&once), once);
}

#[test]
fn names_longer_than_a_line_settle_at_once() {
    let long = "l".repeat(118);
    let once = formatted(&format!(
        "model m {{\n  param b1 = 50, b2 = 150, b3 = -100, {long}b4 = 1, b5 = 2;\n  output y = b1;\n}}"
    ));
    assert_eq!(formatted(&once), once);
}

#[test]
fn neighbours_are_lined_up() {
    let text = "model m {
      state phi \"angle\" [rad], theta  \"pitch angle\" [rad];
      state u [m/s], longer \"speed\" [m/s];
      param a=1[m]; // first
      param beta \"b\" = 2 in [0,1] [m/s] per run;   // second

      param gamma=3;
      der(u)=1; der(longer)=2;
    }";
    let wanted = "model m {
  state phi \"angle\" [rad], theta  \"pitch angle\" [rad];
  state u           [m/s], longer \"speed\"       [m/s];
  param a        = 1           [m];            // first
  param beta \"b\" = 2 in [0, 1] [m/s] per run;  // second

  param gamma = 3;
  der(u)      = 1;
  der(longer) = 2;
}
";
    assert_eq!(formatted(text), wanted, "\n{}", formatted(text));
}

#[test]
fn logarithms_of_params_keep_their_place() {
    let text = "model m { param k=1e-3 in [1e-6,1e3] [1/s] log, a = log(2) log; output y = log(k)*a; }";
    let wanted = "model m {
  param k = 1e-3 in [1e-6, 1e3] [1/s] log, a = log(2) log;
  output y = log(k)*a;
}
";
    assert_eq!(formatted(text), wanted, "\n{}", formatted(text));
}

#[test]
fn rows_of_a_matrix_are_lined_up() {
    let text = "model m { param A[3,2] = [
      [-0.5,a],
      [12 , -0.25*b], // two
      [f(1,2),0]
    ]; param B[1,2]=[[1,2]]; }";
    let wanted = "model m {
  param A[3,2] = [
    [   -0.5,       a],
    [     12, -0.25*b],  // two
    [f(1, 2),       0]
  ];
  param B[1,2] = [[1, 2]];
}
";
    assert_eq!(formatted(text), wanted, "\n{}", formatted(text));
    assert_eq!(formatted(wanted), wanted);
}

#[test]
fn effects_have_the_same_layout() {
    let text = "effect sensor(y:output,z:state|input)unless depends(der(y),z) \"lag of {y}\" {param T=0 in[0,duration/4]try -step,2.5*step;
      replace y with(1+T)*y ;add der(x)+=c*z; noise der(x)=s;}
effect short(i: input) \"s\" { param c = 0; replace i with c*i; }
effect v(i:input){nuisance v0 in scale(i,0.02); const long_name=2*step \"time\";const T=1;}";
    let wanted = "effect sensor(y: output, z: state | input) unless depends(der(y), z) \"lag of {y}\" {
  param T = 0 in [0, duration/4] try -step, 2.5*step;
  replace y with (1 + T)*y;
  add der(x) += c*z;
  noise der(x) = s;
}
effect short(i: input) \"s\" { param c = 0; replace i with c*i; }
effect v(i: input) { nuisance v0 in scale(i, 0.02); const long_name = 2*step \"time\"; const T = 1; }
";
    assert_eq!(layout(text), wanted, "\n{}", layout(text));
    assert_eq!(layout(wanted), wanted);
}

#[test]
fn mistakes_are_told_and_nothing_is_laid_out() {
    let refused = format(&Source::new("t.fdm", "model m { param a = ; output y = a; }"));
    assert!(matches!(refused, Err(Refusal::Mistakes(findings)) if findings.len() == 1));
}

#[test]
fn long_and_deep_texts_take_time_in_proportion() {
    let sum = vec!["a*b"; 50_000].join("+");
    let list: Vec<String> = (0..2_000).map(|k| format!("p{k}=1[m]")).collect();
    let lines: Vec<String> = (0..20_000).map(|k| format!("param q{k}=1[m];\n")).collect();
    let deep = format!("{}a{}", "(".repeat(200), ")".repeat(200));
    let text = format!("model m {{ param {}; {} output y={sum}+{deep}; }}", list.join(","), lines.concat());
    let once = formatted(&text);
    assert!(once.lines().count() > 20_000);
    assert!(once.lines().all(|l| l.chars().count() <= WIDTH.max(420)));
}

/// The words of a text with other spaces, line ends and comments between them.
fn scatter(text: &str, choices: &[u8]) -> String {
    const BETWEEN: [&str; 12] =
        [" ", "  ", "\t", "\n", "\r\n", "\n\n\n", " // ü µ \n", "/* a\n  b */", "\n// own\n", " /**/ ", "\n\n  ", " "];
    let mut out = String::new();
    let mut choices = choices.iter().cycle();
    for (k, piece) in lines::pieces(text).iter().enumerate() {
        let free = k > 0 && !piece.is_index;
        let choice = usize::from(*choices.next().unwrap_or(&0));
        if free && (piece.gap > 0 || piece.line_ends > 0 || choice % 3 == 0) {
            out.push_str(BETWEEN[choice % BETWEEN.len()]);
        }
        out.push_str(&piece.text);
        if piece.shape == lines::Shape::LineComment {
            out.push('\n');
        }
    }
    out
}

/// Texts without mistakes.
static GOOD: std::sync::LazyLock<Vec<String>> = std::sync::LazyLock::new(|| {
    let texts = texts().into_iter().map(|t| t.1).chain([LAID_OUT.into()]);
    texts.filter(|t| syntax::parse(&Source::new("t.fdm", t.as_str())).is_ok()).collect()
});

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn however_it_was_written(which in 0usize..1000, choices in proptest::collection::vec(any::<u8>(), 1..200)) {
        let scattered = scatter(&GOOD[which % GOOD.len()], &choices);
        let once = formatted(&scattered);
        prop_assert!(same_words(&scattered, &once));
        prop_assert_eq!(formatted(&once), once.clone(), "from\n{}", scattered);
        prop_assert!(!once.contains("\n\n\n"));
    }
}

/// A grid as people write it stays as it is; a scattered one is put in order.
#[test]
fn grids_keep_their_rows() {
    let laid_out = "\
model wing {
  input u [rad], v [rad];
  table CL(alpha [rad], delta [rad]) \"lift\" [1] = cubic {
    alpha: [-0.2, 0, 0.2],
    delta: [-0.3, 0.3],
    CL: free [
      [-0.8, -0.7],
      [ 0.1,  0.2],
      [ 0.9,  1.0]
    ]
  };
  table CD(alpha [rad], delta [rad]) [1] = linear from \"cd.csv\" free;
  smooth CL by order 2;
  output y [1] = CL(u, v) + CD(u, v);
}
";
    assert_eq!(formatted(laid_out), laid_out);
    let scattered = "model wing {
input u[rad],v[rad];table CL(alpha[rad],delta[rad])\"lift\"[1]=cubic{
alpha:[-0.2,0,0.2],
delta:[-0.3,0.3],
CL:free[
[-0.8,-0.7],
[0.1,0.2],
[0.9,1.0]
]
};
table CD(alpha [rad],delta [rad]) [1]=linear from \"cd.csv\"free;smooth CL by order 2;
output y [1]=CL(u,v)+CD(u,v);
}
";
    assert_eq!(formatted(scattered), laid_out);
}
