//! A result as one page that needs nothing but a browser: text, equations, tables, figures with zoom and crosshair.
//!
//! **In** the files of a result, from its folder or from memory. **Out** the text of an HTML file that asks for no other. **Never** computes
//! what a reader would quote: numbers come from the files, the page chooses places, colours and digits. Whatever a record, a name or a
//! file says is text. **Start** at [`Subject::from_files`] and [`page`]; `document` puts the sections in their order, each in a file of its
//! own; `figure` (what is drawn) -> `drawing` (as SVG, for readers without scripts and for paper) -> `raster` (as pixels), and `figure.js`
//! (zoom, crosshair); `picture` is a drawing without axes that could be moved.

mod calibration;
mod comparison;
mod convergence;
mod correlations;
mod diagnosis;
mod doctor;
mod document;
pub(crate) mod drawing;
mod equations;
pub(crate) mod figure;
mod headline;
mod histories;
mod job;
mod modes;
mod number;
mod parameters;
mod picture;
mod profile;
mod progress;
#[cfg(feature = "png")]
mod raster;
mod regression;
mod reproduction;
mod requirements;
mod residuals;
mod responses;
mod sample;
mod scale;
mod section;
mod shapes;
mod spectra;
mod starts;
mod study;
mod subject;
mod surfaces;
mod table;
mod thinning;

pub use calibration::calibration_page;
pub use comparison::comparison_page;
pub use doctor::doctor_page;
pub use document::{Drawing, drawings, page};
pub use drawing::Paper;
pub use headline::fit_verdict;
pub use job::job_page;
pub use profile::profile_page;
pub use progress::duration;
#[cfg(feature = "png")]
pub use raster::RasterError;
pub use responses::responses_page;
pub use sample::sample_page;
pub use subject::{Subject, SubjectError};
