//! A result that fills a folder: a fit by any method, regressions, a study, a validation.

use crate::answer::{Answer, NamedFile, Wanted};
use crate::failure::{Failure, OrFailure};
use crate::tables::{histories, run_file, run_tables};
use crate::{margins, modes};
use fdm_estimate::{Fit, responses_of_fit};
use fdm_lab::posterior::Bands;
use fdm_report::{TimeHistory, svg};
use fdm_results::documents::{OutputDocument, Pair, ResultDocument};
use fdm_results::store::{Contents, Manifest};
use fdm_system::Model;
use fdm_system::record::Run;

/// A result and what is said about it.
pub(crate) struct Outcome<'a> {
    pub(crate) model: &'a Model,
    /// The fit in the time domain, whose histories are drawn and written.
    pub(crate) fit: Option<&'a Fit>,
    pub(crate) runs: &'a [Run],
    /// Spectra to be drawn in front of the histories.
    pub(crate) spectra: Vec<TimeHistory<'a>>,
    /// Tables to be written besides.
    pub(crate) tables: Vec<NamedFile>,
    /// Bands of each run, where it is a prediction.
    pub(crate) bands: Vec<Option<Bands>>,
    /// Tables and sentences.
    pub(crate) text: String,
    /// Tables and sentences with all remarks, for the folder; none where nothing is left out.
    pub(crate) whole: Option<String>,
    /// The result for programs.
    pub(crate) json: ResultDocument,
    /// What goes to standard error behind it.
    pub(crate) remarks: Vec<String>,
    pub(crate) manifest: Manifest,
}

impl<'a> Outcome<'a> {
    /// Of a model and runs, with nothing but these.
    pub(crate) fn new(
        (model, runs): (&'a Model, &'a [Run]),
        text: String,
        json: ResultDocument,
        manifest: Manifest,
    ) -> Self {
        let (spectra, tables, bands, remarks) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { model, fit: None, runs, spectra, tables, bands, text, whole: None, json, remarks, manifest }
    }

    /// As far as it is wanted.
    pub(crate) fn answer(mut self, wanted: Wanted) -> Result<Answer, Failure> {
        if wanted.json || wanted.files {
            self.find_modes();
        }
        let mut answer = Answer {
            text: if wanted.verbose { self.whole.clone() } else { None }.unwrap_or_else(|| self.text.clone()),
            json: wanted.json.then(|| self.json.text()).transpose().or_failure()?,
            remarks: self.remarks.clone(),
            plot: wanted.plot.then(|| self.picture()),
            good: true,
            ..Answer::default()
        };
        if wanted.files {
            answer.files = self.contents().files().or_failure()?;
        }
        Ok(answer)
    }

    /// The modes of the model as it was found, its requirements and its frequency responses are part of what is written.
    fn find_modes(&mut self) {
        let runs: Vec<String> = self.runs.iter().map(|run| run.name.clone()).collect();
        let modes = modes::of_result(self.model, &self.json, &runs);
        self.json.set_modes(modes);
        self.json.set_requirements(margins::of_result(self.model, &self.json, &runs));
        let in_time = self.fit.filter(|fit| fit.estimate.termination.is_good());
        let responses = in_time.filter(|_| self.json.is_simulated()).map(|fit| responses_of_fit(fit, self.runs));
        self.json.set_bode(responses.unwrap_or_default().iter().map(Pair::from).collect());
    }

    fn picture(&self) -> String {
        let mut panels = self.spectra.clone();
        panels.extend(self.fit.map_or(Vec::new(), |fit| histories(fit, self.runs)));
        svg(&panels)
    }

    /// Everything that a folder holds.
    fn contents(self) -> Contents {
        let mut text = self.whole.as_ref().unwrap_or(&self.text).clone();
        self.remarks.iter().for_each(|r| text.push_str(&format!("{r}\n")));
        let mut others = vec![("result.txt".to_string(), text.into_bytes())];
        if self.fit.is_some() || !self.spectra.is_empty() {
            others.push(("plot.svg".into(), self.picture().into_bytes()));
        }
        others.extend(self.fit.map_or(Vec::new(), |fit| run_tables(fit, self.runs, &self.bands)));
        others.extend(self.tables);
        let mut texts = self.model.source().texts().iter().map(|t| t.text().to_string());
        let model = texts.next().unwrap_or_default();
        let used = texts.collect();
        let judged = self.fit.map_or(&[][..], |fit| &fit.quality);
        let quality = OutputDocument::of_quality(self.model, judged);
        Contents { manifest: self.manifest, model, used, result: self.json, quality, others }
    }
}

/// Names of all files that the result of any method may have.
pub fn names(model: &Model, runs: &[Run]) -> Vec<String> {
    let own = ["model.fdm", "quality.json", "result.json", "result.txt", "plot.svg"];
    let study = ["study.json", "fit.txt", "repeats.csv"];
    let layout = model.layout();
    let mut names: Vec<String> = own.iter().chain(&study).map(ToString::to_string).collect();
    names.extend((1..model.source().texts().len()).map(|k| format!("model.{k}.fdm")));
    names.extend(runs.iter().enumerate().map(|(k, run)| run_file(k, &run.name)));
    names.extend((1..=runs.len()).map(|k| format!("spectrum_{k}.csv")));
    names.extend((1..=layout.inputs * layout.outputs).map(|k| format!("response_{k}.csv")));
    names
}
