//! The page from its first to its last line.

use super::drawing::Paper;
use super::figure::Figure;
use super::picture::Picture;
#[cfg(feature = "png")]
use super::raster::{self, RasterError};
use super::subject::{Content, Subject};
use super::{drawing, headline};
use crate::html;
use crate::section::{Report, Section};
use crate::words::Words;
use crate::{
    confidence, convergence, correlations, diagnosis, equations, histories, margins, modes, parameters, progress,
    regions, regression, reproduction, residuals, spectral, starts, study, surfaces, validation,
};
use fdm_grammar::Source;
use fdm_grammar::syntax::parse;

/// The whole page; the same subject gives the same text.
pub fn page(subject: &Subject) -> String {
    let sections = match &subject.content {
        Content::AtWork(..) => of_work(subject),
        Content::Diagnosis(found) => {
            diagnosis::sections(subject, found).into_iter().chain(reproduction::section(subject)).collect()
        }
        Content::Result(_) => of_fit(subject),
    };
    html::page(&Words::of(&subject.source).report(Report {
        kind: headline::kind(subject).into(),
        name: subject.name().into(),
        doc: headline::doc(subject).map(str::to_string),
        verdict: headline::verdict(subject),
        sections,
    }))
}

/// What kind of result it is, and the verdict on it in a sentence.
pub fn verdict(subject: &Subject) -> (&'static str, String) {
    (headline::kind(subject), headline::verdict(subject).sentence)
}

/// The equations of a text as MathML, a line for each; none where the text cannot be read.
pub fn typeset(source: &Source) -> Option<String> {
    let lines = equations::lines(&parse(source).ok()?, source);
    Some(lines.iter().map(|line| equations::shown(line, "").into_string()).collect())
}

/// The style of all pages, their colours and the font of formulas among it.
pub fn style() -> String {
    html::style()
}

/// A figure of a page, to be drawn as a file of its own.
#[derive(Debug, Clone)]
pub struct Drawing(Drawn);

#[derive(Debug, Clone)]
enum Drawn {
    Figure(Figure),
    Picture(Picture),
}

impl Drawing {
    /// The name by which it is asked for.
    pub fn name(&self) -> &str {
        match &self.0 {
            Drawn::Figure(figure) => &figure.id,
            Drawn::Picture(picture) => &picture.id,
        }
    }

    /// What it shows.
    pub fn caption(&self) -> &str {
        match &self.0 {
            Drawn::Figure(figure) => &figure.caption,
            Drawn::Picture(picture) => &picture.caption,
        }
    }

    /// Pixels across of the drawing as it stands on the page.
    pub fn width(&self) -> u32 {
        match &self.0 {
            Drawn::Figure(figure) => drawing::size(figure).0 as u32,
            Drawn::Picture(picture) => picture.width as u32,
        }
    }

    /// SVG with caption and key.
    pub fn svg(&self, paper: Paper) -> String {
        match &self.0 {
            Drawn::Figure(figure) => drawing::alone(figure, paper),
            Drawn::Picture(picture) => picture.alone(paper),
        }
    }

    /// The figure as PNG, so many pixels wide: the same bytes on every machine.
    ///
    /// # Errors
    /// [`RasterError`].
    #[cfg(feature = "png")]
    pub fn png(&self, paper: Paper, width: u32) -> Result<Vec<u8>, RasterError> {
        raster::png(&self.svg(paper), width)
    }
}

/// Every figure of the page, in the order of the page.
pub fn drawings(subject: &Subject) -> Vec<Drawing> {
    if let Some(found) = subject.diagnosis() {
        return diagnosis::figures(subject, found).into_iter().map(|f| Drawing(Drawn::Figure(f))).collect();
    }
    let first = subject.study().map_or(Vec::new(), |study| study::figures(study, subject.repeats.as_ref()));
    let of_fit = [regression::figures, surfaces::figures, histories::figures, residuals::figures, spectral::figures];
    let before = first.into_iter().chain(of_fit.into_iter().flat_map(|of| of(subject)));
    let convergence = convergence::figure(subject).into_iter().chain(confidence::figures(subject));
    let behind = starts::figure(subject.starts()).into_iter().chain(convergence);
    let regions = subject.fit().and_then(regions::of_fit);
    let pictures = regions.into_iter().chain(subject.modes().map_or(Vec::new(), modes::pictures)).map(Drawn::Picture);
    let all = before.map(Drawn::Figure).chain(pictures).chain(behind.map(Drawn::Figure));
    all.map(Drawing).collect()
}

fn of_fit(subject: &Subject) -> Vec<Section> {
    let requirements = subject.fit().and_then(|fit| margins::section(&fit.requirements));
    let validation = subject.fit().and_then(|fit| fit.validation.as_ref());
    let modes = subject.modes().filter(|found| !found.modes.is_empty() || found.left_out.is_some());
    let all = [
        validation.map(|found| validation::section(found, None, &subject.time())),
        equations::section(subject),
        parameters::section(subject),
        requirements,
        surfaces::section(subject),
        histories::section(subject),
        residuals::section(subject),
        spectral::section(subject),
        correlations::section(subject),
        modes.map(modes::section),
        many_starts(subject),
        convergence::section(subject),
        confidence::section(subject),
        reproduction::section(subject),
    ];
    studied(subject).into_iter().chain(regression::sections(subject)).chain(all.into_iter().flatten()).collect()
}

/// Of work that goes on: what changes first.
fn of_work(subject: &Subject) -> Vec<Section> {
    let all = [
        convergence::section(subject),
        many_starts(subject),
        parameters::section(subject),
        equations::section(subject),
    ];
    progress::section(subject).into_iter().chain(studied(subject)).chain(all.into_iter().flatten()).collect()
}

fn studied(subject: &Subject) -> Vec<Section> {
    subject.study().map_or(Vec::new(), |study| study::sections(study, subject.repeats.as_ref()))
}

/// Starts as far as they have ended; none of fewer than two.
fn many_starts(subject: &Subject) -> Option<Section> {
    let starts = subject.starts();
    (starts.len() > 1).then(|| starts::section(starts, starts.len()))
}
