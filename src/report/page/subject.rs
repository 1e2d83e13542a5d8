//! What a page is about, read from the files of a result.

use super::columns::Columns;
use super::number::unit_of_frequency;
use fdm_estimate::{Iteration, ParameterEstimate, Status};
use fdm_grammar::Source;
use fdm_grammar::syntax::{SyntaxTree, parse};
use fdm_results::documents::study::Study;
use fdm_results::documents::{
    DiagnosisDocument, FitDocument, KeptParameter, ModesDocument, OutputDocument, ProgressDocument, RegressionDocument,
    ResultDocument, StartDocument, from_text,
};
use fdm_results::store::Manifest;

/// A result, ready to be shown.
#[derive(Debug)]
pub struct Subject {
    /// What it was made from; none of work that goes on.
    pub(crate) manifest: Option<Manifest>,
    /// What there is to show.
    pub(crate) content: Content,
    /// The model's text.
    pub(crate) source: Source,
    /// What the text says; none when this program no longer reads it.
    pub(crate) tree: Option<SyntaxTree>,
    /// The model with the accepted effects.
    pub(crate) extended: Option<(Source, SyntaxTree)>,
    /// Time histories: name of the run, then time, inputs, and of every output measurement, response and residual; of a
    /// diagnosis, responses before and after.
    pub(crate) runs: Vec<(String, Columns)>,
    /// Estimates and errors of every repeat of a study.
    pub(crate) repeats: Option<Columns>,
    /// Spectra: name of the run, then frequency, and of every output real and imaginary parts, measured and modelled.
    pub(crate) spectra: Vec<(String, Columns)>,
}

/// What there is to show.
#[derive(Debug)]
pub(crate) enum Content {
    /// A fit, or regressions.
    Result(ResultDocument),
    /// A diagnosis.
    Diagnosis(Box<DiagnosisDocument>),
    /// Work that goes on, and the seconds since it was reported, where that is longer than it should be.
    AtWork(Box<ProgressDocument>, Option<f64>),
}

/// Why there is no page.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the result lacks `{file}`, or it cannot be read, and a page cannot be made without it")]
pub struct SubjectError {
    /// The file.
    pub file: String,
}

impl Subject {
    /// From the files of a result: names and contents, in any order.
    ///
    /// # Errors
    /// [`SubjectError`] when a file without which there is nothing to show is missing or is not what it should be.
    pub fn from_files(files: &[(String, Vec<u8>)]) -> Result<Self, SubjectError> {
        let lost = |name: &str| SubjectError { file: name.into() };
        let content = |name: &str| {
            let found = files.iter().find(|(n, _)| n == name).map(|(_, content)| String::from_utf8_lossy(content));
            found.ok_or_else(|| lost(name))
        };
        let manifest: Manifest = from_text(&content("manifest.json")?).map_err(|_| lost("manifest.json"))?;
        let source = Source::new(manifest.model_file.as_str(), content("model.fdm")?);
        let tree = parse(&source).ok();
        // a table for each run, by its number: names of files hold names of runs as far as file systems allow
        let tables = |begins: fn(usize) -> String| -> Vec<(String, Columns)> {
            let of_run = |(k, run): (usize, String)| {
                let start = begins(k + 1);
                let (_, content) = files.iter().find(|(name, _)| name.starts_with(&start) && name.ends_with(".csv"))?;
                Some((run, Columns::read(content)?))
            };
            manifest.data.iter().map(|d| d.run.clone()).enumerate().filter_map(of_run).collect()
        };
        let (runs, spectra) = (tables(|k| format!("run_{k}_")), tables(|k| format!("spectrum_{k}.")));
        let diagnosis = content("diagnosis.json").ok().and_then(|text| from_text(&text).ok());
        let found = match diagnosis {
            Some(diagnosis) => Content::Diagnosis(Box::new(diagnosis)),
            None => Content::Result(ResultDocument::read(&content("result.json")?).map_err(|_| lost("result.json"))?),
        };
        let extended = content("extended.fdm").ok().and_then(|text| {
            let source = Source::new("extended.fdm", text);
            parse(&source).ok().map(|tree| (source, tree))
        });
        let repeats = content("repeats.csv").ok().and_then(|text| Columns::read(text.as_bytes()));
        Ok(Self { content: found, extended, runs, repeats, spectra, source, tree, manifest: Some(manifest) })
    }

    /// From the report of work that goes on; `silent` are the seconds since then, where that is longer than it should be.
    ///
    /// # Errors
    /// [`SubjectError`] when the text is something else.
    pub fn from_progress(text: &str, silent: Option<f64>) -> Result<Self, SubjectError> {
        let report = from_text(text).ok().filter(ProgressDocument::is_ours);
        let report = report.ok_or_else(|| SubjectError { file: "progress".into() })?;
        let source = Source::new(report.manifest.model_file.as_str(), report.model_text.as_str());
        let tree = parse(&source).ok();
        Ok(Self {
            manifest: None,
            content: Content::AtWork(Box::new(report), silent),
            extended: None,
            runs: Vec::new(),
            repeats: None,
            spectra: Vec::new(),
            source,
            tree,
        })
    }

    /// The name of the model.
    pub(crate) fn name(&self) -> &str {
        match &self.content {
            Content::Result(result) => result.model(),
            Content::Diagnosis(_) => self.manifest.as_ref().map_or("model", |m| &m.model),
            Content::AtWork(report, _) => &report.result.model,
        }
    }

    /// The unit of time.
    pub(crate) fn time(&self) -> String {
        let column = self.runs.first().and_then(|(_, table)| table.column("t"));
        column.and_then(|c| c.unit.clone()).unwrap_or_else(|| "s".into())
    }

    /// The unit of frequency.
    pub(crate) fn frequency(&self) -> String {
        unit_of_frequency(&self.time())
    }

    /// The fit, where it is one.
    pub(crate) fn fit(&self) -> Option<&FitDocument> {
        match &self.content {
            Content::Result(result) => result.fit(),
            _ => None,
        }
    }

    /// The regressions, where it is some.
    pub(crate) fn regression(&self) -> Option<&RegressionDocument> {
        match &self.content {
            Content::Result(result) => result.regression(),
            _ => None,
        }
    }

    /// The diagnosis, where it is one.
    pub(crate) fn diagnosis(&self) -> Option<&DiagnosisDocument> {
        match &self.content {
            Content::Diagnosis(found) => Some(found),
            _ => None,
        }
    }

    /// The study, where it is one, or work on one.
    pub(crate) fn study(&self) -> Option<&Study> {
        match &self.content {
            Content::AtWork(report, _) => report.result.study.as_ref(),
            _ => self.fit()?.study.as_ref(),
        }
    }

    /// The parameters, as far as they are there.
    pub(crate) fn parameters(&self) -> Vec<ParameterEstimate> {
        let plain = |p: &KeptParameter| ParameterEstimate {
            name: p.name.clone(),
            run: p.run.clone(),
            value: p.value,
            standard_error: p.standard_error,
            corrected_error: p.corrected_error,
            degrees_of_freedom: None,
            unit: p.unit.clone(),
            status: p.status,
            start: None,
            lower: None,
            upper: None,
            limit: None,
            logarithmic: false,
        };
        match &self.content {
            Content::Result(ResultDocument::Fit(fit)) => fit.parameters.clone(),
            Content::Result(ResultDocument::Regression(all)) => all.parameters.iter().map(plain).collect(),
            Content::Diagnosis(_) => Vec::new(),
            Content::AtWork(report, _) => {
                let kept = report.result.parameters.iter().map(|p| KeptParameter {
                    name: p.name.clone(),
                    run: p.run.clone(),
                    value: p.value,
                    status: Status::Estimated,
                    unit: p.unit.clone(),
                    standard_error: None,
                    corrected_error: None,
                });
                kept.map(|p| plain(&p)).collect()
            }
        }
    }

    /// How well outputs are matched in time, or equations of regressions are met.
    pub(crate) fn outputs(&self) -> &[OutputDocument] {
        let equations = || self.regression().map_or(&[][..], |found| &found.outputs);
        self.fit().map_or_else(equations, FitDocument::outputs_in_time)
    }

    /// How well outputs of validation runs were predicted.
    pub(crate) fn predicted(&self) -> &[OutputDocument] {
        self.fit().and_then(|fit| fit.validation_runs.as_ref()).map_or(&[], |predicted| &predicted.outputs)
    }

    /// The iteration.
    pub(crate) fn history(&self) -> &[Iteration] {
        match &self.content {
            Content::AtWork(report, _) => &report.result.history,
            _ => self.fit().map_or(&[], |fit| &fit.history),
        }
    }

    /// What came of the starts that have ended.
    pub(crate) fn starts(&self) -> &[StartDocument] {
        match &self.content {
            Content::AtWork(report, _) => report.result.starts.as_deref().unwrap_or_default(),
            _ => self.fit().map_or(&[], FitDocument::starts),
        }
    }

    /// The modes of the model as it was found.
    pub(crate) fn modes(&self) -> Option<&ModesDocument> {
        match &self.content {
            Content::Result(result) => result.modes(),
            _ => None,
        }
    }
}
