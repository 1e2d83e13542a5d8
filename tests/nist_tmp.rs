use fdm::estimate::*;
use fdm_grammar::model::{Origin, Param, Quantity};
use std::ops::*;
#[derive(Clone, Copy)]
struct D {
    v: f64,
    d: [f64; 9],
}
fn c(v: f64) -> D {
    D { v, d: [0.0; 9] }
}
impl D {
    fn map(self, v: f64, s: f64) -> D {
        D { v, d: self.d.map(|x| x * s) }
    }
    fn exp(self) -> D {
        let e = self.v.exp();
        self.map(e, e)
    }
    fn sin(self) -> D {
        self.map(self.v.sin(), self.v.cos())
    }
    fn cos(self) -> D {
        self.map(self.v.cos(), -self.v.sin())
    }
    fn atan(self) -> D {
        self.map(self.v.atan(), 1.0 / (1.0 + self.v * self.v))
    }
    fn ln(self) -> D {
        self.map(self.v.ln(), 1.0 / self.v)
    }
    fn pow(self, o: D) -> D {
        (self.ln() * o).exp()
    }
    fn sq(self) -> D {
        self * self
    }
}
impl Add for D {
    type Output = D;
    fn add(self, o: D) -> D {
        let mut d = self.d;
        for i in 0..9 {
            d[i] += o.d[i];
        }
        D { v: self.v + o.v, d }
    }
}
impl Sub for D {
    type Output = D;
    fn sub(self, o: D) -> D {
        let mut d = self.d;
        for i in 0..9 {
            d[i] -= o.d[i];
        }
        D { v: self.v - o.v, d }
    }
}
impl Mul for D {
    type Output = D;
    fn mul(self, o: D) -> D {
        let mut d = self.d;
        for i in 0..9 {
            d[i] = d[i] * o.v + o.d[i] * self.v;
        }
        D { v: self.v * o.v, d }
    }
}
impl Div for D {
    type Output = D;
    fn div(self, o: D) -> D {
        let v = self.v / o.v;
        let mut d = self.d;
        for i in 0..9 {
            d[i] = (d[i] - v * o.d[i]) / o.v;
        }
        D { v, d }
    }
}
impl Neg for D {
    type Output = D;
    fn neg(self) -> D {
        c(0.0) - self
    }
}
type F = fn(&[f64], &[D]) -> D;
struct R {
    x: Vec<Vec<f64>>,
    f: F,
}
impl R {
    fn at(&self, k: usize, th: &[f64]) -> D {
        let b: Vec<D> = th
            .iter()
            .enumerate()
            .map(|(i, v)| {
                let mut d = c(*v);
                d.d[i] = 1.0;
                d
            })
            .collect();
        (self.f)(&self.x[k], &b)
    }
}
impl Response for R {
    fn samples(&self) -> usize {
        self.x.len()
    }
    fn outputs(&self) -> usize {
        1
    }
    fn simulate(&mut self, th: &[f64], y: &mut [f64]) -> Result<(), Divergence> {
        for k in 0..self.x.len() {
            y[k] = self.at(k, th).v;
        }
        Ok(())
    }
    fn sensitivities(&mut self, th: &[f64], cols: &[usize], y: &mut [f64], j: &mut [f64]) -> Result<(), Divergence> {
        let s = cols.len().next_multiple_of(8);
        j.fill(0.0);
        for k in 0..self.x.len() {
            let d = self.at(k, th);
            y[k] = d.v;
            for (a, q) in cols.iter().enumerate() {
                j[k * s + a] = d.d[*q];
            }
        }
        Ok(())
    }
}
const PI: f64 = std::f64::consts::PI;
fn models() -> Vec<(&'static str, F)> {
    vec![
        ("Bennett5", |x, b| b[0] * (b[1] + c(x[0])).pow(c(-1.0) / b[2])),
        ("BoxBOD", |x, b| b[0] * (c(1.0) - (-b[1] * c(x[0])).exp())),
        ("Chwirut1", |x, b| (-b[0] * c(x[0])).exp() / (b[1] + b[2] * c(x[0]))),
        ("Chwirut2", |x, b| (-b[0] * c(x[0])).exp() / (b[1] + b[2] * c(x[0]))),
        ("DanWood", |x, b| b[0] * c(x[0]).pow(b[1])),
        ("ENSO", |x, b| {
            let w = 2.0 * PI * x[0];
            let s = c(w / 12.0);
            let (p, q) = (c(w) / b[3], c(w) / b[6]);
            b[0] + b[1] * s.cos() + b[2] * s.sin() + b[4] * p.cos() + b[5] * p.sin() + b[7] * q.cos() + b[8] * q.sin()
        }),
        ("Eckerle4", |x, b| b[0] / b[1] * (c(-0.5) * ((c(x[0]) - b[2]) / b[1]).sq()).exp()),
        ("Gauss1", gauss),
        ("Gauss2", gauss),
        ("Gauss3", gauss),
        ("Hahn1", rat7),
        ("Thurber", rat7),
        ("Kirby2", |x, b| {
            let x = c(x[0]);
            (b[0] + x * (b[1] + x * b[2])) / (c(1.0) + x * (b[3] + x * b[4]))
        }),
        ("Lanczos1", lan),
        ("Lanczos2", lan),
        ("Lanczos3", lan),
        ("MGH09", |x, b| {
            let x = c(x[0]);
            b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3])
        }),
        ("MGH10", |x, b| b[0] * (b[1] / (c(x[0]) + b[2])).exp()),
        ("MGH17", |x, b| b[0] + b[1] * (-b[3] * c(x[0])).exp() + b[2] * (-b[4] * c(x[0])).exp()),
        ("Misra1a", |x, b| b[0] * (c(1.0) - (-b[1] * c(x[0])).exp())),
        ("Misra1b", |x, b| b[0] * (c(1.0) - c(1.0) / (c(1.0) + b[1] * c(x[0] / 2.0)).sq())),
        ("Misra1c", |x, b| b[0] * (c(1.0) - (c(1.0) + b[1] * c(2.0 * x[0])).pow(c(-0.5)))),
        ("Misra1d", |x, b| b[0] * b[1] * c(x[0]) / (c(1.0) + b[1] * c(x[0]))),
        ("Nelson", |x, b| b[0] - b[1] * c(x[0]) * (-b[2] * c(x[1])).exp()),
        ("Rat42", |x, b| b[0] / (c(1.0) + (b[1] - b[2] * c(x[0])).exp())),
        ("Rat43", |x, b| b[0] / (c(1.0) + (b[1] - b[2] * c(x[0])).exp()).pow(c(1.0) / b[3])),
        ("Roszman1", |x, b| b[0] - b[1] * c(x[0]) - (b[2] / (c(x[0]) - b[3])).atan() / c(PI)),
    ]
}
fn gauss(x: &[f64], b: &[D]) -> D {
    let x = c(x[0]);
    b[0] * (-b[1] * x).exp() + b[2] * (-((x - b[3]) / b[4]).sq()).exp() + b[5] * (-((x - b[6]) / b[7]).sq()).exp()
}
fn rat7(x: &[f64], b: &[D]) -> D {
    let x = c(x[0]);
    (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (c(1.0) + x * (b[4] + x * (b[5] + x * b[6])))
}
fn lan(x: &[f64], b: &[D]) -> D {
    let x = c(x[0]);
    b[0] * (-b[1] * x).exp() + b[2] * (-b[3] * x).exp() + b[4] * (-b[5] * x).exp()
}
#[test]
fn nist() {
    let root = "/work/shared/data/nist_strd";
    let cert = std::fs::read_to_string(format!("{root}/certified.csv")).unwrap();
    let (mut sum, mut sums, mut count, mut bad) = (0.0, 0.0, 0, 0);
    for (name, f) in models() {
        let rows: Vec<Vec<&str>> =
            cert.lines().filter(|l| l.split(',').next() == Some(name)).map(|l| l.split(',').collect()).collect();
        let g = |r: &Vec<&str>, k: usize| r[k].parse::<f64>().unwrap();
        let data: Vec<Vec<f64>> = std::fs::read_to_string(format!("{root}/{name}.csv"))
            .unwrap()
            .lines()
            .skip(1)
            .map(|l| l.split(',').map(|v| v.parse().unwrap()).collect())
            .collect();
        for s in [7, 8] {
            let params = rows
                .iter()
                .map(|r| Param {
                    quantity: Quantity { name: r[6].into(), doc: String::new(), unit: None },
                    origin: Origin::Declared,
                    value: g(r, s),
                    lower: f64::NEG_INFINITY,
                    upper: f64::INFINITY,
                    fixed: false,
                    per_run: false,
                })
                .collect();
            let measured = data.iter().map(|d| if name == "Nelson" { d[0].ln() } else { d[0] }).collect();
            let x = data.iter().map(|d| d[1..].to_vec()).collect();
            let run = ProblemRun { name: "r".into(), response: Box::new(R { x, f }), measured, start: vec![] };
            let mut p =
                Problem { params, outputs: vec!["y".into()], runs: vec![run], derived: DerivedQuantities::none() };
            let iterations = std::env::var("LIMIT").ok().and_then(|v| v.parse().ok()).unwrap_or(100);
            let e = estimate(&mut p, &Options { iterations, ..Options::default() }, &mut ()).unwrap();
            let lre = |a: f64, b: f64| (-((a - b) / b).abs().max(1e-11).log10()).max(0.0);
            let l = rows.iter().zip(&e.parameters).map(|(r, p)| lre(p.value, g(r, 9))).fold(11.0, f64::min);
            let ls = rows
                .iter()
                .zip(&e.parameters)
                .map(|(r, p)| lre(p.standard_error.unwrap_or(0.0), g(r, 10)))
                .fold(11.0, f64::min);
            sum += l;
            sums += ls;
            count += 1;
            if l < 4.0 || !e.is_good() {
                bad += 1;
            }
            let refused: usize = e.history.iter().map(|h| h.refused).sum();
            if std::env::var("SHOW").ok().as_deref() == Some(&format!("{name}{}", s - 6)) {
                for h in &e.history {
                    println!(
                        "   {:3} cost {:.6e} change {:.2e} damping {:.1e} step {:.1e} refused {}",
                        h.number, h.cost, h.change, h.damping, h.step, h.refused
                    );
                }
                println!("{:?}", e.parameters.iter().map(|p| p.value).collect::<Vec<_>>());
            }
            println!(
                "{name:9} {} lre {l:5.2} sd {ls:5.2} it {:3} refused {refused:3} eval {:?} cond {:9.2e} {} {:?}",
                s - 6,
                e.iterations,
                e.evaluations,
                e.condition.unwrap_or(0.0),
                e.termination,
                e.undetermined.iter().map(|d| &d.sentence).collect::<Vec<_>>()
            );
        }
    }
    println!("mean {} sd {} bad {bad} of {count}", sum / count as f64, sums / count as f64);
}
