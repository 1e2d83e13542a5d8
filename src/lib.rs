//! Find the mathematical model of a moving vehicle or a chemical reaction from measured data.
//!
#![doc = include_str!("guide.md")]

extern crate self as fdm;

pub mod example;

// The packages, whole: for what the names below do not cover.
#[cfg(feature = "lsp")]
#[doc(hidden)]
pub use fdm_cli::language_server as lsp;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub use fdm_cli::main_with;
#[cfg(feature = "discover")]
pub use fdm_effects as effect;
pub use fdm_estimate as estimate;
pub use fdm_estimate::methods::equation_error;
pub use fdm_estimate::residuals;
#[doc(hidden)]
pub use fdm_grammar as grammar;
#[doc(hidden)]
pub use fdm_grammar::math;
#[cfg(feature = "discover")]
pub use fdm_infer as diagnose;
#[cfg(feature = "report")]
pub use fdm_lab::{design, experiment, job, posterior, requirement, study};
#[cfg(feature = "report")]
pub use fdm_report as report;
#[cfg(feature = "report")]
pub use fdm_report::page;
#[cfg(feature = "report")]
pub use fdm_results::{comparison, documents, store};
#[cfg(feature = "cli")]
#[doc(hidden)]
pub use fdm_session::request;
#[doc(hidden)]
pub use fdm_system::{NotTied, read_source};
pub use fdm_system::{code, dynamics, frequency, linear, record, simulate, spectrum};

// Models.

/// # Example
///
/// ```
/// use fdm::Model;
/// let model = Model::from_text("decay.fdm", "model decay { state x = 1; param k = 0.5 [1/s]; der(x) = -k*x; output y = x; }")?;
/// assert_eq!(model.name(), "decay");
/// assert_eq!(model.definition().start(), [0.5]); // the parameters, in the order of the text
/// assert_eq!((model.layout().states, model.layout().outputs), (1, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::Model;

/// # Example
///
/// ```
/// use fdm::{Model, ModelError};
/// let error = Model::from_text("m.fdm", "model m { state x = 1; der(x) = -k*x; }").unwrap_err();
/// assert!(error.to_string().starts_with("m.fdm:1:"), "{error}");
/// assert!(matches!(Model::from_file("no such file.fdm"), Err(ModelError::Unreadable { .. })));
/// ```
#[doc(inline)]
pub use fdm_system::ModelError;

/// # Example
///
/// ```
/// let model = fdm::Model::from_text("m.fdm", "model m { param a = 1, b = 2; output y = a; }")?;
/// let warning = &model.warnings()[0];
/// assert!(warning.message.contains("`b`"), "{}", warning.message);
/// assert!(warning.line(model.source()).starts_with("m.fdm:1:"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_grammar::Diagnostic;

/// A model compiled with the Rust program that holds it: an expression of type [`Model`].
///
/// What stands between the braces is a model exactly as in a `.fdm` file. It is checked when the program is compiled:
/// every mistake is an error at its place. The numbers come from Rust code, equal to the bit to those of the same
/// model loaded by [`Model::from_file`]. Warnings have no place in a build of stable Rust;
/// [`Model::warnings`] has them.
///
/// # Example
///
/// ```
/// let roll = fdm::model! {
///     model roll "roll decay of a ship" {
///         state p "roll rate" [rad/s], phi "roll angle" [rad] = 0.2;
///         param d = 0.1 [1/s], k = 1.5 [1/s^2];
///         der(p) = -d*p - k*phi;
///         der(phi) = p;
///         output phi_m [rad] = phi;
///     }
/// };
/// assert_eq!(roll.name(), "roll");
/// assert_eq!(roll.layout().states, 2);
/// ```
#[cfg(feature = "macros")]
pub use fdm_macros::model;

/// What is told in the place of the macro where it is not built.
#[cfg(not(feature = "macros"))]
#[doc(hidden)]
#[macro_export]
macro_rules! model {
    ($($text:tt)*) => {
        compile_error!("model! is built with the feature `macros` of fdm\nhint: fdm = { ..., features = [\"macros\"] }")
    };
}

/// The numerical derivative is a complex step (Squire and Trapp, SIAM Review 40, 1998), or a difference where a function is not analytic.
///
/// # Example
///
/// ```
/// use fdm::{code::Nominal, verify};
/// let (model, _) = fdm::example::roll()?;
/// let found = verify(model.definition(), model.schedule(), &Nominal::start(model.definition()));
/// assert!(found.passed(), "{:?}", found.failures);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::code::verify;

/// # Example
///
/// ```
/// use fdm::{Verification, code::Nominal, verify};
/// let (model, _) = fdm::example::decay()?;
/// let found: Verification = verify(model.definition(), model.schedule(), &Nominal::start(model.definition()));
/// assert!(found.compared > 0 && found.failures.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::code::Verification;

// Records.

/// [`Model::run`] makes one from samples in memory, [`Model::read_run`] from a CSV file.
///
/// # Example
///
/// ```
/// let (_, runs) = fdm::example::roll()?;
/// let run = &runs[0];
/// assert_eq!((run.len(), run.inputs.len(), run.measured.len()), (600, 600, 1200)); // N, N by m, N by q
/// let (value, slope) = run.input_at(0, 10.0); // inputs are linear between samples, or held
/// assert!(value.abs() <= 0.1 && slope.is_finite());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::record::Run;

/// # Example
///
/// ```
/// let model = fdm::Model::from_text("m.fdm", "model m {
///   input u [deg]; state x [rad]; param k = 1 [1/s]; der(x) = k*(deg2rad(u) - x); output y [rad] = x; }")?;
/// let run = model
///     .run("step")
///     .times_in("ms", [0.0, 100.0, 200.0])
///     .samples("u", [0.0, 5.0, 5.0])
///     .zero_order_hold("u")
///     .samples_in("y", "deg", [0.0, 0.0, f64::NAN])
///     .build()?;
/// assert_eq!((run.time, run.output_gaps), (vec![0.0, 0.1, 0.2], vec![1]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::record::RunBuilder;

/// # Example
///
/// ```
/// use fdm::record::RunFault;
/// let (model, _) = fdm::example::decay()?;
/// let error = model.run("a").times([0.0, 1.0]).samples("yy", [1.0, 2.0]).build().unwrap_err();
/// assert!(matches!(&error.faults[0], RunFault::Unknown { nearest: Some(name), .. } if name == "y"));
/// assert!(error.to_string().starts_with("run `a`: the model has no channel `yy`; did you mean `y`?"), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::record::RunError;

/// # Example
///
/// ```
/// use fdm::ReadOptions;
/// let (model, _) = fdm::example::decay()?;
/// let file = std::env::temp_dir().join(format!("fdm-read-options-{}.csv", std::process::id()));
/// std::fs::write(&file, "time [ms],level\n0,1.0\n500,0.8\n1000,0.6\n")?;
/// let options = ReadOptions { map: vec![("y".into(), "level".into())], from: Some(500.0), ..ReadOptions::default() };
/// let (run, summary) = model.read_run(&file, &options)?;
/// assert_eq!((run.time, run.measured, summary.used), (vec![0.0, 0.5], vec![0.8, 0.6], 2));
/// # std::fs::remove_file(file)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::record::ReadOptions;

/// # Example
///
/// ```
/// use fdm::ReadOptions;
/// let (model, _) = fdm::example::decay()?;
/// let error = model.read_run("no such file.csv", &ReadOptions::default()).unwrap_err();
/// assert!(error.to_string().starts_with("no such file.csv: the file cannot be read"), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::record::RecordError;

// Simulation, spectra, linear models.

/// Responses are N by q, sensitivities N by q by the chosen parameters; both are exact derivatives of one another.
///
/// # Example
///
/// ```
/// use fdm::Simulator;
/// let (model, runs) = fdm::example::decay()?;
/// let mut simulator = Simulator::new(model.dynamics(), &runs[0], 4)?; // 4 Runge-Kutta steps between samples
/// let mut y = vec![0.0; simulator.samples() * simulator.outputs()];
/// simulator.simulate(&[0.5], &mut y).map_err(|d| format!("not finite at {} s", d.time))?;
/// assert!((y[39] - (-0.5 * 3.9_f64).exp()).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::simulate::Simulator;

/// Chosen once and then kept, so that sensitivities are the derivative of the discrete response (Hairer, Norsett and Wanner 1993).
///
/// # Example
///
/// ```
/// use fdm::{Steps, simulate::{Scheme, StepOptions, choose_steps}};
/// let (model, runs) = fdm::example::decay()?;
/// let chosen = choose_steps(model.dynamics(), &runs[0], &[0.5], &StepOptions::default())?;
/// assert!(chosen.error < 1e-8); // as a part of the output's range
/// assert_eq!(Steps::equal(Scheme::RungeKutta, 4).per_interval(), Some(4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::simulate::Steps;

/// Source: Klein and Morelli 2016, chapter 7; transforms of what lies between the samples, with end-point terms.
///
/// # Example
///
/// ```
/// use fdm::{Frequencies, Spectrum, spectrum::SpectrumOptions};
/// let (_, runs) = fdm::example::roll()?;
/// let band = Frequencies::Band { lowest: 0.1, highest: 0.5, spacing: None }; // cycles per second
/// let spectrum = Spectrum::of(&runs[0], &band, &SpectrumOptions::default())?;
/// assert_eq!(spectrum.inputs.len(), spectrum.omega.len()); // m by M, M frequencies in rad/s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::spectrum::Spectrum;

/// # Example
///
/// ```
/// use fdm::Frequencies;
/// let grid = Frequencies::Grid { lowest: None, highest: Some(1.0) };
/// let frequencies = grid.of(600, 0.05, 1)?; // 600 samples, 0.05 s apart, one channel
/// assert_eq!(frequencies.len(), 30); // 1/30 Hz, 2/30 Hz, ... 1 Hz
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::spectrum::Frequencies;

/// Densities are two-sided, per cycle per unit of time. Source: Bendat and Piersol 2010, chapter 11.
///
/// # Example
///
/// ```
/// use fdm::{CrossSpectra, Frequencies, spectrum::{Segmentation, SpectrumOptions, Window}};
/// let (_, runs) = fdm::example::roll()?;
/// let band = Frequencies::Band { lowest: 0.1, highest: 0.4, spacing: None };
/// let halves = Segmentation::Equal { length: 10.0, overlap: 0.5 };
/// let spectra = CrossSpectra::of(&runs[..1], &band, &halves, Window::Hann, &SpectrumOptions::default())?;
/// assert!(spectra.coherence(0, 1).iter().all(|c| (0.0..=1.0).contains(c))); // rudder and roll rate
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::spectrum::CrossSpectra;

/// Source: Bendat and Piersol 2010, chapters 7 and 9; Tischler and Remple 2012, chapters 7 to 10.
///
/// # Example
///
/// ```
/// use fdm::{CrossSpectra, Frequencies, FrequencyResponseEstimate};
/// use fdm::spectrum::{Segmentation, SpectrumOptions, Window};
/// let (_, runs) = fdm::example::roll()?;
/// let (band, options) = (Frequencies::Band { lowest: 0.1, highest: 0.4, spacing: None }, SpectrumOptions::default());
/// let halves = Segmentation::Equal { length: 10.0, overlap: 0.5 };
/// let spectra = CrossSpectra::of(&runs[..1], &band, &halves, Window::Hann, &options)?;
/// let response = FrequencyResponseEstimate::of(&spectra, &options)?;
/// let roll_rate = &response.response[response.pair(0, 0)]; // of output 0 to input 0
/// assert_eq!(roll_rate.len(), response.omega.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::spectrum::FrequencyResponseEstimate;

/// # Example
///
/// ```
/// use fdm::{LinearModel, linear::Values};
/// let (model, _) = fdm::example::roll()?;
/// let (mut linear, mut values) = (LinearModel::new(&model)?, Values::default());
/// linear.evaluate(&[0.4, 2.0, 0.8], &mut values)?;
/// let coefficients = linear.structure().terms.iter().zip(&values.terms);
/// assert!(coefficients.clone().any(|(_, value)| *value == -2.0)); // phi in the equation of p
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::linear::LinearModel;

/// # Example
///
/// ```
/// use fdm::{LinearModel, Modes, linear::Values};
/// let (model, _) = fdm::example::roll()?;
/// let (mut linear, mut values) = (LinearModel::new(&model)?, Values::default());
/// linear.evaluate(&[0.4, 2.0, 0.8], &mut values)?;
/// let modes = Modes::new(linear.structure(), &values)?;
/// let roll = &modes.modes[0]; // s^2 + 0.4 s + 2
/// assert!((roll.frequency() - 2_f64.sqrt()).abs() < 1e-9); // rad/s
/// assert!((roll.damping().ok_or("no damping")? - 0.2 / 2_f64.sqrt()).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_system::linear::Modes;

// Estimation.

/// Source: output error by maximum likelihood, Maine and Iliff 1985 (NASA RP-1138); standard errors under coloured residuals by Morelli
/// and Klein 1997.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let found = fit(&model, &runs, &FitOptions::default(), &Work::default())?;
/// let k = &found.estimate.parameters[0];
/// assert!((k.value - 0.5).abs() < 4.0 * k.error().ok_or("no error")?); // 1/s, as the model says
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::fit;

/// # Example
///
/// ```
/// use fdm::{Changes, FitOptions, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let changes = Changes { set: vec![("k".into(), 2.0)], ..Changes::default() };
/// let options = FitOptions { changes, per_interval: Some(2), ..FitOptions::default() };
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// assert_eq!(found.estimate.parameters[0].start, Some(2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::FitOptions;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let found = fit(&model, &runs, &FitOptions::default(), &Work::default())?;
/// assert!(found.estimate.is_good() && found.fallback.is_none()); // no fallback strategy was needed
/// assert!(found.integration[0].error < 1e-7);
/// assert_eq!(found.quality.len(), 1); // one output of one run
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Fit;

/// # Example
///
/// ```
/// use fdm::{Changes, FitError, FitOptions, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let changes = Changes { fix: vec!["kk".into()], ..Changes::default() };
/// let error: FitError = fit(&model, &runs, &FitOptions { changes, ..FitOptions::default() }, &Work::default()).unwrap_err();
/// assert!(error.to_string().contains("did you mean `k`?"), "{error}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::FitError;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let estimate = fit(&model, &runs, &FitOptions::default(), &Work::default())?.estimate;
/// let d = estimate.parameter("d", None).ok_or("no such parameter")?;
/// assert_eq!(d.unit.as_deref(), Some("1/s"));
/// assert_eq!(estimate.covariance.size, 3); // of the entries `covered` of `parameters`
/// assert!(estimate.correlated(0.9).is_empty());
/// assert_eq!(estimate.runs[1].residuals.len(), 1200); // N by q
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Estimate;

/// Source of the corrected error: Morelli and Klein 1997; of the interval: Student's law.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let estimate = fit(&model, &runs, &FitOptions::default(), &Work::default())?.estimate;
/// let k = &estimate.parameters[0];
/// let [low, high] = k.interval().ok_or("no interval")?; // 95 %
/// assert!(low < k.value && k.value < high);
/// assert_eq!((k.lower, k.upper), (Some(0.0), Some(10.0)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::ParameterEstimate;

/// # Example
///
/// ```
/// use fdm::{Changes, FitOptions, Status, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let changes = Changes { fix: vec!["b".into()], set: vec![("b".into(), 0.8)], ..Changes::default() };
/// let estimate = fit(&model, &runs, &FitOptions { changes, ..FitOptions::default() }, &Work::default())?.estimate;
/// assert_eq!(estimate.parameter("b", None).map(|p| p.status), Some(Status::Fixed));
/// assert_eq!(estimate.parameter("d", None).map(|p| p.status), Some(Status::Estimated));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Status;

/// Source: Belsley, Kuh and Welsch 1980.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Model, Work, fit};
/// let (_, runs) = fdm::example::decay()?;
/// let text = "model m { state x = 1; param a = 0.5, b = 1; der(x) = -a*b*x; output y = x; }";
/// let found = fit(&Model::from_text("m.fdm", text)?, &runs, &FitOptions::default(), &Work::default())?;
/// let direction = &found.estimate.undetermined[0];
/// assert_eq!(direction.moves.len(), 2); // a up and b down change nothing
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Direction;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Options, Termination, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let options = Options { iterations: 1, ..Options::default() };
/// let found = fit(&model, &runs, &FitOptions { options, ..FitOptions::default() }, &Work::default())?;
/// assert_eq!(found.estimate.termination, Termination::IterationLimit);
/// assert!(!found.estimate.is_good());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Termination;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Noise, Options, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let options = Options { noise: Noise::Given(vec![Some(0.01)]), ..Options::default() };
/// let found = fit(&model, &runs, &FitOptions { options, ..FitOptions::default() }, &Work::default())?;
/// assert!(found.estimate.is_good());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Options;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Loss, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let loss = Loss::Huber(1.345); // outliers pull less than by squares
/// let found = fit(&model, &runs, &FitOptions { loss, ..FitOptions::default() }, &Work::default())?;
/// assert!(found.estimate.is_good());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Loss;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Noise, Options, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let options = Options { noise: Noise::Full, ..Options::default() }; // outputs whose noise may correlate
/// let found = fit(&model, &runs[..1], &FitOptions { options, ..FitOptions::default() }, &Work::default())?;
/// let covariance = found.estimate.noise.ok_or("no noise")?; // q by q
/// assert!((covariance.at(0, 0).sqrt() / 0.005 - 1.0).abs() < 0.15); // rad/s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Noise;

/// # Example
///
/// ```
/// use fdm::Changes;
/// let (model, _) = fdm::example::roll()?;
/// let mut params = model.definition().params.clone();
/// let changes = Changes { set: vec![("d".into(), 0.3)], fix: vec!["b".into()], ..Changes::default() };
/// assert_eq!(changes.apply(&mut params), Ok(false)); // nothing was freed
/// assert_eq!((params[0].value, params[2].fixed), (0.3, true));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Changes;

/// # Example
///
/// ```
/// use fdm::{FitOptions, MultiStart, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions { starts: MultiStart { count: 3, seed: 1 }, ..FitOptions::default() };
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// assert_eq!(found.starts.len(), 3);
/// assert_eq!(found.starts[0].minimum, Some(1)); // the best one
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::MultiStart;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, estimate::Iteration, fit};
/// use std::sync::Mutex;
/// let (model, runs) = fdm::example::decay()?;
/// let costs = Mutex::new(Vec::new());
/// let follow = |iteration: &Iteration| costs.lock().map_or((), |mut costs| costs.push(iteration.cost));
/// fit(&model, &runs, &FitOptions::default(), &Work::default().telling(&follow))?;
/// let costs = costs.into_inner()?;
/// assert!(costs.windows(2).all(|c| c[1] <= c[0]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Observer;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Termination, Work, estimate::Halt, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let halt = Halt::default();
/// halt.interrupt(); // by another thread, as a rule
/// let found = fit(&model, &runs, &FitOptions::default(), &Work::until(&halt))?;
/// assert_eq!(found.estimate.termination, Termination::Interrupted); // with the best so far
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Work;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Method, Work, identify};
/// let (model, runs) = fdm::example::roll()?;
/// for method in [Method::OutputError, Method::EquationError] {
///     let found = identify(&model, &runs, &FitOptions { method, ..FitOptions::default() }, &Work::default())?;
///     assert!(found.is_good());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::identify;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Identified, Work, identify};
/// let (model, runs) = fdm::example::decay()?;
/// let found = identify(&model, &runs, &FitOptions::default(), &Work::default())?;
/// assert!(matches!(found, Identified::OutputError(_)));
/// assert_eq!(found.estimate().map(|e| e.parameters.len()), Some(1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Identified;

/// # Example
///
/// ```
/// use fdm::{Domain, Method};
/// assert!(Method::OutputError.is_of(Domain::Frequency));
/// assert!(!Method::FilterError.is_of(Domain::Frequency));
/// ```
#[doc(inline)]
pub use fdm_estimate::Method;

/// # Example
///
/// ```
/// use fdm::{Domain, FitOptions, Identified, Work, identify};
/// let (model, runs) = fdm::example::roll()?;
/// let options = FitOptions { domain: Domain::Frequency, ..FitOptions::default() };
/// assert!(matches!(identify(&model, &runs, &options, &Work::default())?, Identified::Spectra(_)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Domain;

/// Source: Nelder and Mead 1965; Liu and Nocedal 1989 (L-BFGS); Gauss-Newton steps as in Maine and Iliff 1985.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Optimizer, Options, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let options = Options { optimizer: Optimizer::Lbfgs, ..Options::default() };
/// let found = fit(&model, &runs, &FitOptions { options, ..FitOptions::default() }, &Work::default())?;
/// assert!((found.estimate.parameters[0].value - 0.5).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::Optimizer;

/// Source: Maine and Iliff 1981; Jategaonkar 2015, chapter 5.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Model, Work, fit_filter};
/// let (_, runs) = fdm::example::decay()?;
/// let text = "model m { state x = 1; param k = 0.4, s = 0.05 in [1e-4, 1]; der(x) = -k*x; noise der(x) = s; output y = x; }";
/// let found = fit_filter(&Model::from_text("m.fdm", text)?, &runs, &FitOptions::default(), &Work::default())?;
/// assert!((found.fit.estimate.parameters[0].value - 0.5).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::fit_filter;

/// # Example
///
/// ```
/// use fdm::{FilterFit, FitOptions, Model, Work, fit_filter};
/// let (_, runs) = fdm::example::decay()?;
/// let text = "model m { state x = 1; param k = 0.4, s = 0.05 in [1e-4, 1]; der(x) = -k*x; noise der(x) = s; output y = x; }";
/// let found: FilterFit = fit_filter(&Model::from_text("m.fdm", text)?, &runs, &FitOptions::default(), &Work::default())?;
/// assert_eq!(found.deviations.len(), 1); // of the measurement noise of y
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::FilterFit;

/// Source: Klein and Morelli 2016, chapter 7; end-point terms by McKelvey 2002.
///
/// # Example
///
/// ```
/// use fdm::{SpectralOptions, Work, fit_spectra};
/// let (model, runs) = fdm::example::roll()?;
/// let found = fit_spectra(&model, &runs, &SpectralOptions::default(), &Work::default())?;
/// let d = found.estimate.parameter("d", None).ok_or("no such parameter")?;
/// assert!((d.value - 0.4).abs() < 0.02);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::fit_spectra;

/// # Example
///
/// ```
/// use fdm::{Frequencies, SpectralOptions, Work, fit_spectra};
/// let (model, runs) = fdm::example::roll()?;
/// let frequencies = Frequencies::Grid { lowest: Some(0.1), highest: Some(0.8) };
/// let options = SpectralOptions { frequencies, ..SpectralOptions::default() };
/// let (low, high) = fit_spectra(&model, &runs, &options, &Work::default())?.band;
/// assert!(0.1 <= low && high <= 0.8); // cycles per second
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::SpectralOptions;

/// # Example
///
/// ```
/// use fdm::{SpectralFit, SpectralOptions, Work, fit_spectra};
/// let (model, runs) = fdm::example::roll()?;
/// let found: SpectralFit = fit_spectra(&model, &runs, &SpectralOptions::default(), &Work::default())?;
/// let spectrum = &found.spectra[0]; // of the first run
/// assert_eq!(spectrum.measured.len(), spectrum.modelled.len());
/// assert!(found.is_good());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::SpectralFit;

/// Source: Tischler and Remple 2012, chapters 9 and 11.
///
/// # Example
///
/// ```
/// use fdm::{Frequencies, ResponseOptions, Work, fit_responses};
/// let (model, runs) = fdm::example::roll()?;
/// let frequencies = Frequencies::Band { lowest: 0.1, highest: 0.4, spacing: None };
/// let options = ResponseOptions { frequencies, segments: vec![10.0], ..ResponseOptions::default() };
/// let found = fit_responses(&model, &runs[..1], &options, &Work::default())?;
/// let omega2 = found.estimate.parameter("omega2", None).ok_or("none")?.value;
/// assert!(1.5 < omega2 && omega2 < 2.5, "{omega2}"); // segments of 10 s resolve 0.1 Hz
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::fit_responses;

/// # Example
///
/// ```
/// use fdm::ResponseOptions;
/// let options = ResponseOptions { pairs: vec![("p_m".into(), "rudder".into())], ..ResponseOptions::default() };
/// assert_eq!((options.coherence, options.segments.len()), (0.6, 0)); // segments are chosen by the record's length
/// ```
#[doc(inline)]
pub use fdm_estimate::ResponseOptions;

/// # Example
///
/// ```
/// use fdm::{Frequencies, ResponseFit, ResponseOptions, Work, fit_responses};
/// let (model, runs) = fdm::example::roll()?;
/// let frequencies = Frequencies::Band { lowest: 0.1, highest: 0.4, spacing: None };
/// let options = ResponseOptions { frequencies, segments: vec![10.0], ..ResponseOptions::default() };
/// let found: ResponseFit = fit_responses(&model, &runs[..1], &options, &Work::default())?;
/// assert_eq!(found.pairs.len(), 2); // roll rate and roll angle to the rudder
/// assert!(found.cost().is_some_and(|cost| cost < 100.0)); // below 100 by Tischler's scale: an acceptable model
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::ResponseFit;

/// Source: Klein and Morelli 2016, chapters 5 and 8; principal components by Black, Murray-Smith and Padfield 1986.
///
/// # Example
///
/// ```
/// use fdm::{RegressionOptions, regress};
/// let (model, runs) = fdm::example::roll()?;
/// let found = regress(&model, &runs, &RegressionOptions::default())?;
/// let d = found.fits[0].parameters.iter().find(|p| p.name == "d").ok_or("no such parameter")?;
/// assert!((d.value - 0.4).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::equation_error::regress;

/// # Example
///
/// ```
/// use fdm::{RegressionOptions, equation_error::{Detrend, Smoothing}, regress};
/// let (model, runs) = fdm::example::roll()?;
/// let options = RegressionOptions { smoothing: Smoothing::Optimal, detrend: Detrend::Mean, ..RegressionOptions::default() };
/// assert!(regress(&model, &runs, &options)?.fits[0].equations[0].r_squared > 0.9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::equation_error::RegressionOptions;

/// # Example
///
/// ```
/// use fdm::{Regression, RegressionOptions, regress};
/// let (model, runs) = fdm::example::roll()?;
/// let found: Regression = regress(&model, &runs, &RegressionOptions::default())?;
/// assert!(found.refused.is_empty()); // every equation with parameters is linear in them
/// assert_eq!(found.fits[0].parameters.len(), 3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::equation_error::Regression;

// Residuals.

/// For optimisers and samplers of other packages.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, ResidualVector};
/// let (model, runs) = fdm::example::decay()?;
/// let mut vector = ResidualVector::new(&model, &runs, &[1.0], &FitOptions::default())?; // in units of the output
/// let (mut r, mut jacobian) = (vec![0.0; vector.len()], vec![0.0; vector.len()]); // R, and R by one unknown
/// vector.jacobian(&[0.5], &mut r, &mut jacobian).map_err(|d| format!("not finite at {} s", d.time))?;
/// assert!(r.iter().all(|r| r.abs() < 0.05) && jacobian[10] > 0.0); // a faster decay leaves less
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::ResidualVector;

/// # Example
///
/// ```
/// use fdm::{Simulator, run_quality};
/// let (model, runs) = fdm::example::decay()?;
/// let mut y = vec![0.0; runs[0].len()];
/// Simulator::new(model.dynamics(), &runs[0], 4)?.simulate(&[0.3], &mut y).map_err(|_| "not finite")?;
/// let quality = run_quality(&model, &runs[0], &y);
/// assert!(quality[0].fit.rms.ok_or("not compared")? > 0.05); // k = 0.3 is far off
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::residuals::run_quality;

/// Source of Theil's inequality coefficient: Theil 1961; Jategaonkar 2015, chapter 11.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let found = fit(&model, &runs[..1], &FitOptions::default(), &Work::default())?;
/// let roll_angle = &found.quality[1];
/// assert!(roll_angle.fit.tic.ok_or("not compared")? < 0.3); // Theil's coefficient: a good model
/// assert_eq!(roll_angle.inputs[0].input, "rudder");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::residuals::OutputQuality;

/// Source: Ljung and Box 1978; Durbin and Watson 1950; Wald and Wolfowitz 1940.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Whiteness, Work, fit};
/// let (model, runs) = fdm::example::roll()?;
/// let found = fit(&model, &runs[..1], &FitOptions::default(), &Work::default())?;
/// let whiteness: &Whiteness = found.quality[0].whiteness.as_ref().ok_or("not tested")?;
/// assert!(whiteness.p_value > 0.001);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[doc(inline)]
pub use fdm_estimate::residuals::Whiteness;

// Diagnosis.

/// Source: the evidence of linearised models under a mixture of noise spectra (MacKay 1992; Bishop 2006, chapter 10); docs/theory/discovery.md.
///
/// # Example
///
/// ```
/// use fdm::{Catalogue, DiagnosisOptions, Verdict, Work, diagnose};
/// let (model, runs) = fdm::example::roll()?;
/// let mut catalogue = Catalogue::standard();
/// catalogue.retain(|effect| effect == "cubic_stiffness");
/// let found = diagnose(&model, &runs[..1], &runs[1..], &catalogue, &DiagnosisOptions::default(), &Work::default())?;
/// assert_eq!(found.verdict, Verdict::NoEffectFound); // the model is right
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "discover")]
#[doc(inline)]
pub use fdm_infer::diagnose;

/// # Example
///
/// ```
/// use fdm::{Catalogue, Diagnosis, DiagnosisOptions, Work, diagnose};
/// let (model, runs) = fdm::example::decay()?;
/// let mut catalogue = Catalogue::standard();
/// catalogue.retain(|effect| effect == "quadratic_damping");
/// let found: Diagnosis = diagnose(&model, &runs, &[], &catalogue, &DiagnosisOptions::default(), &Work::default())?;
/// assert!(found.causes.is_empty() && found.extended.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "discover")]
#[doc(inline)]
pub use fdm_infer::Diagnosis;

/// # Example
///
/// ```
/// use fdm::DiagnosisOptions;
/// let options = DiagnosisOptions { most: 1, ..DiagnosisOptions::default() };
/// assert_eq!(options.most, 1); // effects that are added
/// ```
#[cfg(feature = "discover")]
#[doc(inline)]
pub use fdm_infer::DiagnosisOptions;

/// # Example
///
/// ```
/// use fdm::Verdict;
/// let advice = |verdict| match verdict {
///     Verdict::RecordFault => "mend the records",
///     Verdict::EffectFound => "see the extended text",
///     Verdict::Disturbance => "estimate process noise with the filter",
///     Verdict::Law => "a function of one signal is missing",
///     Verdict::UnknownCause => "something is wrong that nothing in the model explains",
///     Verdict::NoEffectFound => "the records say nothing against the model",
/// };
/// assert_eq!(advice(Verdict::EffectFound), "see the extended text");
/// ```
#[cfg(feature = "discover")]
#[doc(inline)]
pub use fdm_infer::Verdict;

/// # Example
///
/// ```
/// use fdm::Catalogue;
/// let catalogue = Catalogue::standard();
/// assert!(catalogue.effects().count() > 20);
/// ```
#[cfg(feature = "discover")]
#[doc(inline)]
pub use fdm_effects::Catalogue;

// Results, studies, pages.

/// Source: parametric bootstrap, Efron and Tibshirani 1993, chapter 6.
///
/// # Example
///
/// ```
/// use fdm::{Bootstrap, FitOptions, Work, fit, series, study::Colour};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions::default();
/// let work = Work::default();
/// let found = fit(&model, &runs, &options, &work)?;
/// let bootstrap = Bootstrap::new(&found, &runs, &options, (Colour::White, 1))?;
/// let repeats = series(3, &work, &|_, _| (), &|number| bootstrap.once(number, work.halt()));
/// assert!(repeats.iter().flatten().all(|repeat| repeat.is_good()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::study::Bootstrap;

/// # Example
///
/// ```
/// use fdm::{Work, series, study::Repeat};
/// // every repeat draws from a stream of its own, so that results do not depend on threads
/// let once = |number: u64| (number != 2).then(|| Repeat::gone("for the example", 1));
/// let repeats = series(4, &Work::default(), &|_, _| (), &once);
/// assert_eq!(repeats.iter().flatten().count(), 3);
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::study::series;

/// # Example
///
/// ```
/// use fdm::{Bootstrap, FitOptions, Study, Work, fit, series, study::Colour};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions::default();
/// let work = Work::default();
/// let bootstrap = Bootstrap::new(&fit(&model, &runs, &options, &work)?, &runs, &options, (Colour::White, 1))?;
/// let repeats = series(4, &work, &|_, _| (), &|number| bootstrap.once(number, work.halt()));
/// let study = Study::of(model.name(), (Some(Colour::White), 1), bootstrap.subjects(), &repeats);
/// assert_eq!((study.done, study.parameters.len()), (4, 1)); // coverage and bias of each parameter
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::study::Study;

/// Source: profile likelihood, Bates and Watts 1988, chapter 6.
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, Profiler, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions::default();
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// let profile = Profiler::new(&found, &runs, &options, &Work::default())?.of("k")?;
/// assert!(profile.ends[0].value() < profile.value && profile.value < profile.ends[1].value());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::study::Profiler;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Profile, Profiler, Work, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions::default();
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// let profile: Profile = Profiler::new(&found, &runs, &options, &Work::default())?.of("k")?;
/// assert_eq!((profile.name.as_str(), profile.unit.as_deref()), ("k", Some("1/s")));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::study::Profile;

/// Source: Mehra 1974; manoeuvres as in Jategaonkar 2015, chapter 2.
///
/// # Example
///
/// ```
/// use fdm::{Question, design, estimate::Halt};
/// let (model, _) = fdm::example::roll()?;
/// let question = Question {
///     model: &model,
///     theta: vec![0.4, 2.0, 0.8],
///     deviations: vec![0.005, 0.005], // rad/s, rad
///     known: Vec::new(),
///     rest: vec![0.0],
///     heights: vec![Some(0.1)], // rad
///     rates: vec![Some(0.2)],   // rad/s
///     limits: vec![None, None],
///     duration: 20.0,
///     dt: 0.1,
///     runs: 1,
/// };
/// let found = design(&question, &Halt::default()).map_err(|reasons| reasons.join("; "))?;
/// assert_eq!(found.steps[0].manoeuvre.input, "rudder");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::design::design;

/// # Example
///
/// ```
/// use fdm::Question;
/// let (model, runs) = fdm::example::roll()?;
/// let theta = vec![0.4, 2.0, 0.8];
/// let question = Question {
///     model: &model,
///     known: vec![(runs[0].clone(), theta.clone())], // what was flown already
///     theta,
///     deviations: vec![0.005; 2],
///     rest: vec![0.0],
///     heights: vec![Some(0.1)],
///     rates: vec![None],
///     limits: vec![None, None],
///     duration: 10.0,
///     dt: 0.1,
///     runs: 1,
/// };
/// assert_eq!(question.known[0].0.name, "sweep");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::design::Question;

/// # Example
///
/// ```
/// use fdm::{Design, Question, design, estimate::Halt};
/// let (model, _) = fdm::example::roll()?;
/// let (theta, deviations, heights) = (vec![0.4, 2.0, 0.8], vec![0.005; 2], vec![Some(0.1)]);
/// let (duration, dt, runs, rest, known) = (20.0, 0.1, 1, vec![0.0], Vec::new());
/// let (rates, limits) = (vec![None], vec![None; 2]);
/// let question = Question { model: &model, theta, deviations, known, rest, heights, rates, limits, duration, dt, runs };
/// let found: Design = design(&question, &Halt::default()).map_err(|reasons| reasons.join("; "))?;
/// let d = &found.outlook[0];
/// assert!(d.now.is_none() && d.then[0].is_some()); // not known now; its standard error behind the run
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_lab::design::Design;

/// Source: Burnham and Anderson 2002 (criteria); Diebold and Mariano 1995 (predictions).
///
/// # Example
///
/// ```
/// use fdm::{FitOptions, ResultFolder, Work, compare, comparison::Candidate, fit, store::{Contents, Destination}};
/// let (model, runs) = fdm::example::decay()?;
/// let place = std::env::temp_dir().join(format!("fdm-compare-{}", std::process::id()));
/// let options = FitOptions::default();
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// Contents::of_fit(&found, &runs, &options).write(&Destination::prepare(&place)?)?;
/// let comparison = compare(vec![Candidate::new(&ResultFolder::open(&place)?)]);
/// assert_eq!(comparison.candidates[0].unknowns, 1);
/// # std::fs::remove_dir_all(place)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_results::comparison::compare;

/// # Example
///
/// ```
/// let nothing: fdm::Comparison = fdm::compare(Vec::new());
/// assert!(nothing.candidates.is_empty() && nothing.inflation.is_none());
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_results::comparison::Comparison;

/// # Example
///
/// ```
/// use fdm::{FitDocument, FitOptions, Work, documents::{from_text, to_text}, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let document = FitDocument::of(&fit(&model, &runs, &FitOptions::default(), &Work::default())?);
/// let text = to_text(&document)?; // JSON, as `fdm fit --json` prints it
/// let again: FitDocument = from_text(&text)?;
/// assert_eq!(to_text(&again)?, text);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_results::documents::FitDocument;

/// # Example
///
/// ```
/// use fdm::{FitOptions, ResultFolder, Work, fit, store::{Contents, Destination}};
/// let (model, runs) = fdm::example::decay()?;
/// let place = std::env::temp_dir().join(format!("fdm-folder-{}", std::process::id()));
/// let options = FitOptions::default();
/// let found = fit(&model, &runs, &options, &Work::default())?;
/// Contents::of_fit(&found, &runs, &options).write(&Destination::prepare(&place)?)?;
/// let folder = ResultFolder::open(&place)?; // refused when something in it was changed
/// assert_eq!((folder.parameters()[0].name.as_str(), folder.model()?.name()), ("k", "decay"));
/// # std::fs::remove_dir_all(place)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_results::store::ResultFolder;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, estimate_table, fit};
/// let (model, runs) = fdm::example::decay()?;
/// let table = estimate_table(&fit(&model, &runs, &FitOptions::default(), &Work::default())?.estimate);
/// assert!(table.contains("Cramer-Rao") && table.contains("1/s"), "{table}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_report::estimate_table;

/// # Example
///
/// ```
/// use fdm::{FitOptions, Work, fit, page, page::Subject, store::Contents};
/// let (model, runs) = fdm::example::decay()?;
/// let options = FitOptions::default();
/// let files = Contents::of_fit(&fit(&model, &runs, &options, &Work::default())?, &runs, &options).files()?;
/// let html = page(&Subject::from_files(&files)?);
/// assert!(html.starts_with("<!DOCTYPE html>"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[cfg(feature = "report")]
#[doc(inline)]
pub use fdm_report::page::page;

/// The README, whose Rust code is run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;

/// The first page of the guide, whose Rust code is run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../docs/guide/first-record.md")]
pub struct FirstRecord;
