//! Integration errors that no estimate should be trusted with: what is fitted is then the steps, not the model.

use super::fit::Fit;
use fdm_system::record::Run;
use fdm_system::simulate::WorstError;
use std::fmt;

/// An integration error above 1e-3 of an output's range, or one that may move an estimate by as much as its error.
#[derive(Debug, Clone, PartialEq)]
pub struct IntegrationFault {
    /// The run.
    pub run: String,
    /// The output.
    pub output: String,
    /// Time since the run began where the error is largest, in the model's time unit.
    pub time: f64,
    /// The error there, as a part of the output's range; infinite where the response with half of the steps is not finite.
    pub part: f64,
    /// The error there beside the standard deviation of the output's residual; none where nothing of it was compared.
    pub beside_residual: Option<f64>,
    /// By how many of its standard errors all errors together may move an estimate, at most; none where nothing was compared.
    pub shift: Option<f64>,
    /// The state that is farthest off there; none where that is not known.
    pub state: Option<String>,
    /// Whether method and steps were left to be chosen, so that nothing is gained by leaving them.
    pub chosen: bool,
}

/// Standard errors by which an estimate may be moved before it is that of the steps.
const MOVED: f64 = 1.0;
/// Whether errors may move an estimate that far: the root of the sum of their squares, over the standard deviation of the noise, bounds what least squares make of
/// them (Cauchy and Schwarz).
pub(crate) fn is_moving(norm: f64, deviation: f64) -> bool {
    norm > MOVED * deviation
}

impl IntegrationFault {
    /// Of the places where a run of a fit is integrated worst.
    pub(crate) fn of(fit: &Fit, run: &Run, worst: &[WorstError]) -> Vec<Self> {
        let definition = fit.model.definition();
        let of = |worst: &WorstError| {
            let output = definition.outputs[worst.output].quantity.name.clone();
            let matched = fit.estimate.outputs.iter().find(|o| o.run == run.name && o.name == output);
            let deviation = matched.and_then(|o| o.rms).map(|rms| rms.max(f64::MIN_POSITIVE));
            Self {
                run: run.name.clone(),
                output,
                time: run.time[worst.sample],
                part: worst.part,
                beside_residual: deviation.map(|deviation| worst.error / deviation),
                shift: deviation.map(|deviation| worst.norm / deviation),
                state: worst.state.map(|j| definition.states[j].quantity.name.clone()),
                chosen: false,
            }
        };
        worst.iter().map(of).collect()
    }

    /// Whether some estimate may be that of the steps, and not of the model.
    pub fn is_severe(&self) -> bool {
        self.shift.is_none_or(|shift| is_moving(shift, 1.0))
    }
}

impl fmt::Display for IntegrationFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { run, output, time, part, beside_residual, shift, state, .. } = self;
        if part.is_infinite() {
            write!(f, "run `{run}`: with half of the integration steps the response is not finite at time {time}")?;
        } else {
            write!(f, "run `{run}`: integration error {part:.0e} of the range of `{output}` at time {time}")?;
        }
        if let Some(state) = state {
            write!(f, ", where state `{state}` is farthest off")?;
        }
        if let Some(beside) = beside_residual.filter(|beside| beside.is_finite()) {
            write!(f, "; {beside:.1e} of the standard deviation of its residual")?;
        }
        if let Some(shift) = shift.filter(|shift| shift.is_finite()) {
            write!(f, ", which may move an estimate by up to {shift:.1} of its standard errors")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::methods::output_error::options::FitOptions;
    use crate::methods::time_domain::fit;
    use crate::work::Work;
    use fdm_system::model::Model;
    use fdm_system::record::Run;

    /// A pendulum at full swing, seen four times in a period.
    fn faults(noise: f64, steps: usize) -> (bool, Vec<super::IntegrationFault>) {
        let text = "model m { input u; state x = 1; state v = 0; param w = 1; der(x) = v; der(v) = u - w*w*sin(x); output y = x; }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let time: Vec<f64> = (0..40).map(|k| 1.2 * f64::from(k)).collect();
        let blank = Run {
            name: "r".into(),
            inputs: vec![0.0; time.len()],
            held: vec![false],
            measured: vec![0.0; time.len()],
            input_gaps: vec![0],
            stated: Vec::new(),
            output_gaps: vec![0],
            time,
        };
        let mut simulator = fdm_system::simulate::Simulator::new(model.dynamics(), &blank, 64).unwrap();
        let mut measured = vec![0.0; blank.len()];
        simulator.simulate(&model.definition().start(), &mut measured).unwrap();
        let rough = |k: usize| noise * ((k * k * 7 % 11) as f64 / 5.0 - 1.0);
        measured.iter_mut().enumerate().for_each(|(k, y)| *y += rough(k));
        let run = Run { measured, ..blank };
        let found =
            fit(&model, &[run], &FitOptions { per_interval: Some(steps), ..FitOptions::default() }, &Work::default())
                .unwrap();
        (found.is_good(), found.integration_faults)
    }

    #[test]
    fn steps_that_are_fitted_instead_of_the_model_are_told_with_place_and_state() {
        let (good, found) = faults(1e-3, 1);
        assert!(!good && found[0].is_severe() && found[0].part > 1e-3, "{found:?}");
        assert!(found[0].state.is_some() && found[0].time > 0.0 && found[0].to_string().contains("`y`"), "{found:?}");
        // beside much more noise the same error does not matter, and is said all the same
        let (good, found) = faults(2.0, 2);
        assert!(good && found.iter().all(|f| !f.is_severe()), "{found:?}");
        assert!(faults(1e-3, 32).1.is_empty());
    }

    #[test]
    fn errors_far_below_the_noise_are_told_where_many_samples_average_it() {
        let text = "model m { input u; state x = 0; param a = 0.5; der(x) = u - a*x; output y = x; }";
        let model = Model::from_text("m.fdm", text).unwrap();
        let fault = |count: usize, steps: usize| {
            let time: Vec<f64> = (0..count).map(|k| 1.8 * k as f64).collect();
            let inputs: Vec<f64> = (0..count).map(|k| ((k / 7) % 2) as f64).collect();
            let (held, gaps) = (vec![true], vec![0]);
            let measured = vec![0.0; count];
            let blank = Run {
                name: "r".into(),
                time,
                inputs,
                held,
                measured,
                input_gaps: gaps.clone(),
                stated: Vec::new(),
                output_gaps: gaps,
            };
            let mut simulator = fdm_system::simulate::Simulator::new(model.dynamics(), &blank, 64).unwrap();
            let mut measured = vec![0.0; count];
            simulator.simulate(&model.definition().start(), &mut measured).unwrap();
            let mut normal = fdm_numeric::random::Normal(3);
            measured.iter_mut().for_each(|y| *y += 0.4 * normal.next());
            let run = Run { measured, ..blank };
            let options = FitOptions { per_interval: Some(steps), ..FitOptions::default() };
            let found = fit(&model, &[run], &options, &Work::default()).unwrap();
            let a = found.estimate.parameter("a", None).unwrap();
            let off = (a.value - 0.5) / a.standard_error.unwrap();
            (off, found.is_good(), found.integration_faults)
        };
        let ((off, good, faults), (right, sound, none)) = (fault(40_000, 1), fault(40_000, 16));
        assert!(!good && sound && none.is_empty(), "{faults:?} {none:?}");
        assert!(
            faults[0].beside_residual.unwrap() < 0.1 && faults[0].shift.unwrap() > (off - right).abs(),
            "{faults:?}"
        );
        assert!((off - right).abs() > 0.1, "{off} {right}");
        let (off, good, faults) = fault(100, 1);
        assert!(off.abs() < 2.5 && good, "{off} {faults:?}");
    }
}
