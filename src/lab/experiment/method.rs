//! A description's words as options of the rooms that estimate.

use super::description::Stage;
use super::experiment_error::Fault;
use super::setting::Setting;
use fdm_estimate::equation_error::{
    Components, Detrend, Preprocessing, RecursiveOptions, RegressionOptions, Smoothing,
};
use fdm_estimate::{
    BestOptions, Domain, FitOptions, FrequencyOptions, Method, MultiStart, Noise, Nonlinear, Options, Shooting,
    StartValues,
};
use fdm_system::frequency::EndTerms;
use fdm_system::spectrum::Frequencies;

impl Stage {
    fn frequencies(&self) -> Frequencies {
        match (self.band, self.df) {
            (Some([lowest, highest]), Some(df)) => Frequencies::Band { lowest, highest, spacing: Some(df) },
            // from 0 on: from the first that the record has
            (Some([low, high]), None) => Frequencies::Grid { lowest: (low > 0.0).then_some(low), highest: Some(high) },
            (None, _) => Frequencies::Grid { lowest: None, highest: None },
        }
    }

    fn estimation(&self) -> Options {
        let noise = if self.full_noise { Noise::Full } else { Noise::default() };
        Options { noise, ..Options::default() }
    }

    fn word<T>(&self, word: Option<&str>, wanted: &'static str, known: &[(&str, T)]) -> Result<Option<T>, Fault>
    where
        T: Clone,
    {
        let Some(word) = word else { return Ok(None) };
        let found = known.iter().find(|(name, _)| *name == word).map(|(_, value)| value.clone());
        found.map(Some).ok_or_else(|| Fault::Word { place: format!("step `{}`", self.name), word: word.into(), wanted })
    }

    /// Options of a fit in the time domain.
    pub(super) fn in_time(&self, setting: &Setting) -> FitOptions {
        let starts =
            self.starts.map_or_else(MultiStart::default, |count| MultiStart { count, ..MultiStart::default() });
        FitOptions {
            changes: setting.changes.clone(),
            options: self.estimation(),
            substitute: self.substitute.clone(),
            shooting: self.shooting.map(Shooting::Segments),
            confidence: self.confidence,
            starts,
            ..FitOptions::default()
        }
    }

    /// Options of an estimation by a method; equation error is one at frequencies where a band is given, and a fit of spectra ends in the time
    /// domain where figures of it are asked for.
    pub(super) fn of_method(&self, method: Method, setting: &Setting) -> Result<FitOptions, Fault> {
        let domain = match method {
            Method::FrequencyResponse => Domain::Frequency,
            Method::EquationError if self.band.is_some() => Domain::Frequency,
            _ => self.domain.unwrap_or_default(),
        };
        let mut options = FitOptions { method, domain, ..self.in_time(setting) };
        if domain == Domain::Frequency {
            options.frequency.frequencies = self.frequencies();
            options.frequency.finish = false;
        }
        match (method, domain) {
            (Method::OutputError, Domain::Frequency) => options.frequency = self.of_spectra(options.frequency)?,
            (Method::EquationError, _) => options.regression = self.regression()?,
            _ => {}
        }
        Ok(options)
    }

    fn of_spectra(&self, options: FrequencyOptions) -> Result<FrequencyOptions, Fault> {
        let ends = [("free", EndTerms::Unknown), ("known", EndTerms::Known), ("none", EndTerms::Omitted)];
        let nonlinear = [("measured-regressors", Nonlinear::MeasuredRegressors), ("linearise", Nonlinear::Linearised)];
        let of_time = |name: &String| ["rms(", "r2(", "tic("].iter().any(|kind| name.starts_with(kind));
        Ok(FrequencyOptions {
            ends: self.word(self.end_points.as_deref(), "`free`, `known`, `none`", &ends)?.unwrap_or(EndTerms::Unknown),
            nonlinear: self
                .word(self.nonlinear.as_deref(), "`measured-regressors`, `linearise`", &nonlinear)?
                .unwrap_or_default(),
            input_noise: self.input_noise.iter().map(|(name, deviation)| (name.clone(), *deviation)).collect(),
            regressed: self.start_values != Some(StartValues::Model),
            finish: self.expected.keys().any(of_time),
            ..options
        })
    }

    /// Options of recursive least squares.
    pub(super) fn recursively(&self) -> BestOptions {
        let preprocessing = Preprocessing { cutoff: self.lowpass, points: self.polynomial, detrend: Detrend::None };
        let default = RecursiveOptions::default();
        let recursion = RecursiveOptions { forgetting: self.forgetting.unwrap_or(default.forgetting), preprocessing };
        BestOptions { recursion, restart: self.restart, ..BestOptions::default() }
    }

    fn regression(&self) -> Result<RegressionOptions, Fault> {
        let components = match self.components.as_deref() {
            None | Some("auto") => Components::Auto,
            Some("level") => Components::Levelled,
            Some(count) => {
                let wanted = "`auto`, `level`, a number";
                let place = || format!("step `{}`", self.name);
                let count = count.parse().map_err(|_| Fault::Word { place: place(), word: count.into(), wanted })?;
                Components::Count(count)
            }
        };
        let smoothing = self.smooth.map_or_else(Smoothing::default, |points| Smoothing::Local { points });
        Ok(RegressionOptions { smoothing, components, ..RegressionOptions::default() })
    }
}
