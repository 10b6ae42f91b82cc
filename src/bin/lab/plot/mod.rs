//! Pictures of the laboratory, drawn with the panels of the library.

mod charts;
mod families;
mod marks;

pub use charts::{Chart, Curve, Ink, Stroke, charts};
pub use families::{Family, Traced, families};
