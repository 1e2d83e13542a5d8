//! A result as one page that needs nothing but a browser: text, equations, tables, figures with zoom and crosshair.
//!
//! **In** the files of a result, from its folder or from memory. **Out** the text of an HTML file that asks for no other. **Never** computes
//! what a reader would quote: numbers come from the files, the page chooses places, colours and digits. Whatever a record, a name or a
//! file says is text. **Start** at [`Subject::from_files`] and [`page`]; `document` puts the sections of the topics in their order.
//! `figure` (what is drawn) -> `drawing` (as SVG, for readers without scripts and for paper) -> `raster` (as pixels), and `figure.js`
//! (zoom, crosshair); `picture` is a drawing without axes that could be moved.

pub(crate) mod columns;
pub(crate) mod document;
pub(crate) mod drawing;
pub(crate) mod figure;
pub(crate) mod headline;
pub(crate) mod number;
pub(crate) mod picture;
#[cfg(feature = "png")]
pub(crate) mod raster;
pub(crate) mod scale;
pub(crate) mod subject;
pub(crate) mod thinning;

pub use crate::calibration::calibration_page;
pub use crate::comparison::comparison_page;
pub use crate::design::{design_page, experiments_page};
pub use crate::doctor::doctor_page;
pub use crate::fit::fit_verdict;
pub use crate::job::job_page;
pub use crate::profile::profile_page;
pub use crate::progress::duration;
pub use crate::response::responses_page;
pub use crate::sample::sample_page;
pub use document::{Drawing, drawings, page, style, typeset, verdict};
pub use drawing::Paper;
#[cfg(feature = "png")]
pub use raster::RasterError;
pub use subject::{Subject, SubjectError};
