//! Which options have a part in which method: what the library ignores it refuses, in the words of the command.

use crate::methods::output_error::error::StrategyError;
use crate::methods::output_error::options::{Continuation, FitOptions, FrequencyOptions};
use crate::problem::Options;
use crate::problem::method::{Domain, Method, Optimizer, SmoothBy};
use fdm_system::simulate::Scheme;

/// Methods in the domains where they work, the usual ones first.
pub const METHODS: [(Method, Domain); 6] = [
    (Method::OutputError, Domain::Time),
    (Method::OutputError, Domain::Frequency),
    (Method::FilterError, Domain::Time),
    (Method::EquationError, Domain::Time),
    (Method::EquationError, Domain::Frequency),
    (Method::FrequencyResponse, Domain::Frequency),
];

const Y: bool = true;
const N: bool = false;

/// An option as the command spells it, the columns in which it has a part, and whether it was given: is other than usual.
type Row = (&'static str, [bool; 6], fn(&FitOptions) -> bool);

/// Output error in time and frequency, filter error, equation error in time and frequency, frequency responses.
const OPTIONS: [Row; 25] = [
    ("--optimizer gauss-newton", [Y, Y, Y, Y, Y, Y], |_| false),
    ("--optimizer nelder-mead", [Y, Y, N, N, N, Y], |o| o.options.optimizer == Optimizer::NelderMead),
    ("--optimizer lbfgs", [Y, Y, N, N, N, Y], |o| o.options.optimizer == Optimizer::Lbfgs),
    ("--loss", [Y, N, N, N, N, N], |o| !o.loss.is_squares()),
    ("--iterations", [Y, Y, Y, N, N, Y], |o| o.options.total.is_some()),
    ("--tolerance", [Y, Y, N, N, N, Y], |o| o.options.tolerance != Options::default().tolerance),
    ("--gain", [Y, Y, N, N, N, Y], |o| o.options.gain != Options::default().gain),
    ("--smooth-by", [Y, Y, N, N, N, N], |o| o.options.smooth_by != SmoothBy::default()),
    ("--starts", [Y, N, N, N, N, N], |o| o.starts.count > 1),
    ("--continuation", [Y, N, N, N, N, N], |o| {
        matches!(o.continuation, Continuation::Shares(_) | Continuation::Times(_))
    }),
    ("--substitute", [Y, N, N, N, N, N], |o| !o.substitute.is_empty()),
    ("--shooting", [Y, N, N, N, N, N], |o| o.shooting.is_some()),
    ("--confidence", [Y, N, N, N, N, N], |o| o.confidence),
    ("--weights", [Y, N, N, N, N, N], |o| o.reweight),
    ("--steps", [Y, N, Y, N, N, N], |o| o.per_interval.is_some()),
    ("--integration-accuracy", [Y, N, N, N, N, N], |o| o.accuracy.is_some()),
    ("--integrator runge-kutta", [Y, N, Y, N, N, N], |o| o.scheme == Some(Scheme::RungeKutta)),
    ("--integrator radau", [Y, N, N, N, N, N], |o| o.scheme == Some(Scheme::Radau)),
    ("--band", [N, Y, N, N, Y, Y], |o| o.frequency.frequencies != FrequencyOptions::default().frequencies),
    ("--end-points", [N, Y, N, N, N, N], |o| o.frequency.ends != FrequencyOptions::default().ends),
    ("--nonlinear", [N, Y, N, N, N, N], |o| o.frequency.nonlinear != FrequencyOptions::default().nonlinear),
    ("--input-noise", [N, Y, N, N, N, N], |o| !o.frequency.input_noise.is_empty()),
    ("--segments", [N, N, N, N, N, Y], |o| !o.frequency.segments.is_empty()),
    ("--pair", [N, N, N, N, N, Y], |o| !o.frequency.pairs.is_empty()),
    ("--coherence", [N, N, N, N, N, Y], |o| o.frequency.coherence != FrequencyOptions::default().coherence),
];

/// Whether an option, as the command spells it, has a part in a method on data of a domain; none of options that no method has, and where the
/// method does not work there.
pub fn takes_option(option: &str, method: Method, domain: Domain) -> Option<bool> {
    let column = METHODS.iter().position(|own| *own == (method, domain))?;
    OPTIONS.iter().find(|(name, ..)| *name == option).map(|(_, columns, _)| columns[column])
}

/// The options that [`takes_option`] knows, as the command spells them.
pub fn option_names() -> impl Iterator<Item = &'static str> {
    OPTIONS.iter().map(|(name, ..)| *name)
}

/// The first option that was given and would be ignored.
pub(crate) fn ignored(options: &FitOptions, method: Method, domain: Domain) -> Option<StrategyError> {
    if !options.censored.is_empty() && (method, domain) != METHODS[0] {
        return Some(StrategyError::Censored { method, domain });
    }
    let column = METHODS.iter().position(|own| *own == (method, domain))?;
    let (option, ..) = OPTIONS.iter().find(|(_, columns, given)| !columns[column] && given(options))?;
    Some(StrategyError::OptionOfMethod { option, method, domain })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::methods::output_error::options::{MultiStart, Shooting};

    #[test]
    fn what_would_be_ignored_is_named() {
        let filter = |options: FitOptions| ignored(&options, Method::FilterError, Domain::Time);
        assert_eq!(filter(FitOptions::default()), None);
        assert_eq!(filter(FitOptions { continuation: Continuation::Never, bare: true, ..FitOptions::default() }), None);
        let starts = MultiStart { count: 4, ..MultiStart::default() };
        let gain = Options { gain: 0.5, ..Options::default() };
        for (options, name) in [
            (FitOptions { starts, ..FitOptions::default() }, "--starts"),
            (FitOptions { options: gain, ..FitOptions::default() }, "--gain"),
            (FitOptions { shooting: Some(Shooting::Segments(3)), ..FitOptions::default() }, "--shooting"),
            (FitOptions { accuracy: Some(1e-6), ..FitOptions::default() }, "--integration-accuracy"),
        ] {
            let said = filter(options.clone()).expect("ignored").to_string();
            assert!(said.starts_with(name) && said.contains("filter error"), "{said}");
            assert_eq!(ignored(&options, Method::OutputError, Domain::Time), None, "{name}");
        }
    }
}
