//! Pictures as SVG, one function a picture. Every picture is drawn from panels: axes that know their
//! range, in a finer unit than a pixel so that curves stay smooth.
//!
//! Colours are Okabe and Ito's: blue for the Fokker-Planck equation, vermilion for Monte Carlo, black for
//! the closed form.

mod canvas;
mod charts;
mod contours;
mod density;
mod driven;
mod families;
mod force;
mod impacts;
mod legend;
mod losses;
#[cfg(feature = "cli")]
mod map;
mod panel;
mod spectrum;
mod ticks;
mod transient;

pub use charts::{Chart, Curve, Ink, Stroke, charts};
pub(crate) use density::{densities, steady, stroboscopic};
pub(crate) use driven::{periodic, response};
pub use families::{Family, Traced, families};
pub(crate) use force::force;
pub(crate) use impacts::impacts;
pub(crate) use losses::{flights, passage, survival};
#[cfg(feature = "cli")]
pub(crate) use map::{Field, Ruler, map};
pub(crate) use spectrum::spectrum;
pub(crate) use transient::{approach, moments};
