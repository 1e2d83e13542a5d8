//! A drawing that is the same at every size: no axis that a reader could move, no values under a crosshair.

use super::drawing::{self, Paper, Sheet};
use maud::{Markup, html};

/// A picture.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    /// A name of its own on the page.
    pub(crate) id: String,
    /// What it shows, in words.
    pub(crate) caption: String,
    /// On paper, in pixels.
    pub(crate) width: f64,
    pub(crate) height: f64,
    /// The inside of its SVG.
    pub(crate) body: Markup,
}

impl Picture {
    /// As it stands on the page.
    pub(crate) fn markup(&self) -> Markup {
        html! {
            figure id=(self.id) {
                figcaption { span.caption { (self.caption) } }
                div.canvas.scroll {
                    svg viewBox={ "0 0 " (self.width) " " (self.height) } width=(self.width) height=(self.height) role="img" aria-label=(self.caption) { (self.body) }
                }
            }
        }
    }

    /// As a file of its own.
    pub(crate) fn alone(&self, paper: Paper) -> String {
        let (width, height, body) = (self.width, self.height, self.body.clone());
        drawing::file(&[Sheet { caption: self.caption.clone(), key: html! {}, width, height, body }], paper)
    }
}
