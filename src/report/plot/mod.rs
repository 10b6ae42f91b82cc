//! Pictures as SVG, one function a picture. Every picture is drawn from panels: axes that know their
//! range, in a finer unit than a pixel so that curves stay smooth.
//!
//! Colours are Okabe and Ito's: blue for the Fokker-Planck equation, vermilion for Monte Carlo, black for
//! the closed form.

mod canvas;
mod contours;
mod density;
mod driven;
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

#[cfg(feature = "cli")]
pub(crate) use canvas::Picture;
pub use canvas::{
    Area, BLUE, CENTRED, Colour, Drawn, FAINT, FINE, Font, GREEN, GREY, HALO, Hang, INK, Points,
    SUBTITLE, VERMILION, WORDS, fine, line, picture, write,
};
pub(crate) use density::{densities, snapshots, steady, stroboscopic};
pub(crate) use driven::{periodic, response};
pub(crate) use force::force;
pub(crate) use impacts::impacts;
pub use legend::{Mark, legend};
pub(crate) use losses::{flights, passage, survival};
#[cfg(feature = "cli")]
pub(crate) use map::{Field, Ruler, map};
pub use panel::{Panel, range};
pub(crate) use spectrum::spectrum;
pub use ticks::superscript;
pub(crate) use transient::{approach, moments};
