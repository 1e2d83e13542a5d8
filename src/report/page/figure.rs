//! What a figure shows: panels above each other over one axis, marks in them, and how many samples they stand for.

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

/// Fewer samples than this are seen one by one on paper: they are seven dots' widths apart.
const FEW: usize = 60;

/// No more things than this stand beside each other on half the width: two hundred pixels for each are enough for its name and a look at its dots.
const THINGS: usize = 3;

/// A figure.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// A name of its own on the page.
    pub(crate) id: String,
    /// Figures of one group keep their axes equal.
    pub(crate) group: String,
    /// What it shows, in words.
    pub(crate) caption: String,
    /// Label of the axis below.
    pub(crate) label: String,
    /// Whether that axis is logarithmic.
    pub(crate) logarithmic: bool,
    /// Places on that axis, of all marks.
    pub(crate) at: Vec<f64>,
    pub(crate) panels: Vec<Panel>,
    /// What the places are called, where they are things and not numbers.
    pub(crate) names: Vec<String>,
    /// Whether two of them stand beside each other.
    pub(crate) half: bool,
    /// Of how many samples it was drawn, where that is not all of them.
    pub(crate) samples: Option<usize>,
}

/// One pair of axes.
#[derive(Debug, Clone)]
pub(crate) struct Panel {
    pub(crate) label: String,
    /// In pixels.
    pub(crate) height: u32,
    pub(crate) logarithmic: bool,
    pub(crate) marks: Vec<Mark>,
}

/// A line, or whatever else has a value at every place.
#[derive(Debug, Clone)]
pub(crate) struct Mark {
    pub(crate) name: String,
    pub(crate) look: Look,
    pub(crate) shape: Shape,
    /// One value for each place; NaN where there is none.
    pub(crate) values: Vec<f64>,
    /// The other edge of a band or a bar, the foot of a stem.
    pub(crate) low: Vec<f64>,
}

/// The colour of a mark, by what it means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Look {
    Measured,
    Model,
    Residual,
    Input,
    Other,
    Bound,
}

/// How values are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Line,
    Dots,
    Stems,
    Band,
    Bars,
    /// From the foot to the value, as wide as places are apart.
    Columns,
}

impl Look {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Model => "model",
            Self::Residual => "residual",
            Self::Input => "input",
            Self::Other => "other",
            Self::Bound => "bound",
        }
    }
}

impl Shape {
    /// Whether a swatch of one is that of the other.
    fn is_like(self, other: Self) -> bool {
        let strokes = |shape| matches!(shape, Self::Line | Self::Stems | Self::Bars);
        self == other || strokes(self) && strokes(other)
    }

    fn word(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Dots => "dots",
            Self::Stems => "stems",
            Self::Band => "band",
            Self::Bars => "bars",
            Self::Columns => "columns",
        }
    }
}

impl Mark {
    /// A line.
    pub(crate) fn line(name: &str, look: Look, values: Vec<f64>) -> Self {
        Self { name: name.into(), look, shape: Shape::Line, values, low: Vec::new() }
    }

    /// Samples: a line through many, and dots where they are few, since a line would tell of what was not measured.
    pub(crate) fn samples(name: &str, look: Look, values: Vec<f64>) -> Self {
        match values.iter().filter(|v| v.is_finite()).count() {
            few if few < FEW => Self::dots(name, look, values),
            _ => Self::line(name, look, values),
        }
    }

    /// A dot at every place.
    pub(crate) fn dots(name: &str, look: Look, values: Vec<f64>) -> Self {
        Self { name: name.into(), look, shape: Shape::Dots, values, low: Vec::new() }
    }

    /// Something between or on two edges.
    pub(crate) fn between(name: &str, look: Look, shape: Shape, low: Vec<f64>, values: Vec<f64>) -> Self {
        Self { name: name.into(), look, shape, values, low }
    }
}

impl Panel {
    pub(crate) fn new(label: impl Into<String>, height: u32, marks: Vec<Mark>) -> Self {
        Self { label: label.into(), height, logarithmic: false, marks }
    }

    pub(crate) fn logarithmic(self) -> Self {
        self.scaled(true)
    }

    pub(crate) fn scaled(self, logarithmic: bool) -> Self {
        Self { logarithmic, ..self }
    }
}

impl Figure {
    /// A figure without panels, in a group of its own.
    pub(crate) fn new(
        id: impl Into<String>,
        caption: impl Into<String>,
        label: impl Into<String>,
        at: Vec<f64>,
    ) -> Self {
        let id = id.into();
        Self {
            group: id.clone(),
            id,
            caption: caption.into(),
            label: label.into(),
            logarithmic: false,
            at,
            panels: Vec::new(),
            names: Vec::new(),
            half: false,
            samples: None,
        }
    }

    pub(crate) fn in_group(self, group: impl Into<String>) -> Self {
        Self { group: group.into(), ..self }
    }

    pub(crate) fn with(self, panel: Panel) -> Self {
        self.with_all(vec![panel])
    }

    pub(crate) fn with_all(mut self, panels: Vec<Panel>) -> Self {
        self.panels.extend(panels);
        self
    }

    pub(crate) fn logarithmic(self) -> Self {
        Self { logarithmic: true, ..self }
    }

    pub(crate) fn named(self, names: Vec<String>) -> Self {
        Self { names, ..self }
    }

    pub(crate) fn half(self) -> Self {
        Self { half: true, ..self }
    }

    /// Of so many samples, where not all are drawn.
    pub(crate) fn thinned(self, samples: Option<usize>) -> Self {
        Self { samples, ..self }
    }

    /// The figure with what the script needs; drawn already for readers without scripts.
    pub(crate) fn markup(&self) -> Markup {
        html! {
            figure.plot.few[self.is_few()] id=(self.id) data-group=(self.group) {
                figcaption {
                    span.caption { (self.caption) }
                    span.legend {
                        @for mark in self.key() {
                            span.key { span class={ "swatch " (mark.look.word()) " " (mark.shape.word()) } {} (mark.name) }
                        }
                    }
                }
                div.canvas.scroll { (super::drawing::svg(self)) }
                output.readout { }
                @if let Some(samples) = self.samples {
                    p.note { "Drawn from " (self.at.len()) " of " (samples) " samples: the extremes of every part of the record." }
                }
                (data(&self.data()))
            }
        }
    }

    /// Whether dots at so few places would be lost on the whole width.
    pub(crate) fn is_few(&self) -> bool {
        let mut marks = self.panels.iter().flat_map(|p| &p.marks);
        self.at.len() <= THINGS && marks.all(|m| matches!(m.shape, Shape::Dots | Shape::Bars))
    }

    /// The marks that need a key: each look once, by the name that it has first; not those that the axis names already, and none without a value.
    pub(crate) fn key(&self) -> Vec<&Mark> {
        let mut found: Vec<&Mark> = Vec::new();
        for panel in &self.panels {
            let needs = |m: &&Mark| !m.name.is_empty() && !panel.label.starts_with(&m.name);
            for mark in panel.marks.iter().filter(needs).filter(|m| m.values.iter().any(|v| v.is_finite())) {
                if !found.iter().any(|m| m.look == mark.look && m.shape.is_like(mark.shape)) {
                    found.push(mark);
                }
            }
        }
        found
    }

    /// Room beside the first and the last place, as a part of the axis: lines end at the frame, what stands alone is to be seen whole.
    pub(crate) fn margin(&self) -> f64 {
        let marks = || self.panels.iter().flat_map(|p| &p.marks);
        if marks().any(|m| m.shape == Shape::Columns) || !self.names.is_empty() {
            // half a column, or half the way to the next thing
            return 0.5 / (self.at.len().max(2) - 1) as f64 + 0.01;
        }
        if marks().all(|m| m.shape == Shape::Line) { 0.0 } else { 0.02 }
    }

    fn data(&self) -> FigureData<'_> {
        let mark = |m: &Mark| MarkData {
            look: m.look.word(),
            low: (!m.low.is_empty()).then(|| rounded(&m.low)),
            name: m.name.clone(),
            shape: m.shape.word(),
            values: rounded(&m.values),
        };
        let panel = |p: &Panel| PanelData {
            height: p.height,
            label: p.label.clone(),
            logarithmic: p.logarithmic,
            marks: p.marks.iter().map(mark).collect(),
        };
        FigureData {
            at: &self.at,
            label: &self.label,
            logarithmic: self.logarithmic,
            margin: self.margin(),
            names: &self.names,
            panels: self.panels.iter().map(panel).collect(),
        }
    }
}

/// What the script of the page draws from.
#[derive(Serialize)]
struct FigureData<'a> {
    at: &'a [f64],
    label: &'a str,
    logarithmic: bool,
    margin: f64,
    #[serde(skip_serializing_if = "<[String]>::is_empty")]
    names: &'a [String],
    panels: Vec<PanelData>,
}

#[derive(Serialize)]
struct PanelData {
    height: u32,
    label: String,
    logarithmic: bool,
    marks: Vec<MarkData>,
}

#[derive(Serialize)]
struct MarkData {
    look: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    low: Option<Vec<Option<f64>>>,
    name: String,
    shape: &'static str,
    values: Vec<Option<f64>>,
}

/// Values with the digits that anybody reads; what is not finite is null.
fn rounded(values: &[f64]) -> Vec<Option<f64>> {
    values.iter().map(|v| format!("{v:.7e}").parse::<f64>().ok().filter(|v| v.is_finite())).collect()
}

/// A block of data. Nothing in it can end the block or begin another, whatever names and values say.
fn data(of: &FigureData<'_>) -> Markup {
    // numbers, texts and lists always have a text
    let text = serde_json::to_string(of).unwrap_or_default();
    let text = text.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026");
    html! { script type="application/json" { (PreEscaped(text)) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_names_stay_inside_their_block() {
        let figure = Figure::new("a", "</script><script>alert(1)</script>", "\"]}</script><!--", vec![0.0, 1.0])
            .in_group("g")
            .with_all(Vec::new());
        let text = figure.markup().into_string();
        assert_eq!(text.matches("<script").count(), 1);
        assert_eq!(text.matches("</script").count(), 1);
        assert!(!text.contains("<!--"));
        let block = text.split("application/json\">").nth(1).and_then(|t| t.split("</script>").next()).unwrap();
        assert_eq!(serde_json::from_str::<serde_json::Value>(block).unwrap()["label"], "\"]}</script><!--");
    }

    #[test]
    fn few_samples_are_dots_and_a_key_has_each_look_once() {
        let shape = |n: usize| Mark::samples("y", Look::Measured, vec![1.0; n]).shape;
        assert_eq!((shape(16), shape(1600)), (Shape::Dots, Shape::Line));
        let line = |name: &str, look| Mark::line(name, look, vec![0.0, 1.0]);
        let figure = Figure::new("a", "", "t", vec![0.0, 1.0])
            .with(Panel::new("y", 90, vec![line("before", Look::Residual), line("after", Look::Model)]))
            .with(Panel::new("residual", 90, vec![line("residual before", Look::Residual)]));
        let names: Vec<&str> = figure.key().iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["before", "after"]);
    }

    #[test]
    fn dots_of_few_things_are_narrow_and_marks_without_values_have_no_key() {
        let figure = |count: usize| {
            let dots = |name, value| Mark::dots(name, Look::Model, vec![value; count]);
            let marks = vec![dots("now", f64::NAN), Mark { look: Look::Residual, ..dots("then", 1.0) }];
            Figure::new("a", "", "", vec![0.0; count]).with(Panel::new("y", 100, marks))
        };
        assert_eq!(figure(3).key().iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["then"]);
        assert!(figure(3).markup().into_string().contains("class=\"plot few\""));
        assert!(!figure(4).is_few());
    }
}
