//! Random vibration of a preloaded Hertzian contact that now and then loses contact.
//!
//! ```text
//! q'' + 2 zeta q' + G(q) = f(t),   G(q) = [(1 + 2q/3)_+]^(3/2) - 1,   E f(t) f(0) = 2 pi h delta(t)
//! dp/dt + v dp/dq = d/dv[(2 zeta v + G(q)) p] + pi h d2p/dv2
//! ```
//!
//! Everything is dimensionless, (6)-(8): displacement q in 2/3 of the static compression, time in
//! 1/Omega, force in the static load. Numbers in brackets are equations of J. Perret-Liaudet and
//! E. Rigaud, "Experiments and numerical results on non-linear vibrations of an impacting Hertzian
//! contact. Part 2: random excitation".
//!
//! ```
//! use vibroimpact::contact::ContactLaw;
//! use vibroimpact::oscillator::Oscillator;
//! use vibroimpact::plan::Plan;
//! use vibroimpact::scene::{Outputs, Scene};
//!
//! let mut scene = Scene::new(Oscillator::new(ContactLaw::Hertz, 0.005, 2e-3)?);
//! scene.outputs = Outputs { steady: true, ..Outputs::default() };
//! scene.method.cells = Some([40, 30]);
//! let results = Plan::of(&scene)?.run_quietly()?;
//! let density = &results.steady.unwrap().density;
//! assert_eq!(density.p.dim(), (density.q.len(), density.v.len()));
//! # Ok::<(), vibroimpact::Error>(())
//! ```
//!
//! | question | where |
//! |---|---|
//! | Everything a scene asks for, as the program does it | [`scene`], [`plan`], [`results`] |
//! | The stationary law in closed form | [`stationary`] |
//! | The density over time, the steady state, decay rates | [`fokker_planck`] |
//! | The same by sampling | [`monte_carlo`] |
//! | A spectrum without sampling noise | [`fokker_planck::spectrum()`] |
//! | Spectra from records | [`spectrum`] |
//! | How long until contact is lost, how long it flies | [`fokker_planck::first_loss()`], [`fokker_planck::flight_law`] |
//! | How fast it comes back and how hard it strikes | [`fokker_planck::impact_law`] |
//! | A contact law of a scene, or of my own | [`contact::ContactLaw::given`], [`contact::Restoring`] |
//! | A harmonic drive, noise that grows or fades | [`excitation`] |
//! | The motion without noise, its periodic orbits | [`noise_free`] |
//! | Newtons, micrometres, hertz, seconds | [`rig`] |
//! | The unit of times, in a scene and in what is written | [`clock`] |
//! | Signs, units, one- and two-sided | [`conventions`] |
//! | What an error is, and relative to what | [`estimate`], [`scales`] |
//! | Tables, files, pictures | [`report`] |
//!
//! The paper number by number, error against run time and the stiff and extreme scenes are a program of their own:
//! `cargo run --release --bin lab -- --help`. What only that, the program and the Python package use of the library is not
//! on these pages, and may change.

mod budget;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
pub mod clock;
pub mod contact;
pub mod conventions;
pub mod damping;
pub mod error;
pub mod estimate;
pub mod excitation;
mod first_step;
pub mod fokker_planck;
mod format;
pub mod gaussian;
pub mod initial;
mod inrush;
#[cfg(feature = "cli")]
pub mod map;
mod matrix;
pub mod moments;
pub mod monte_carlo;
pub mod noise_free;
pub mod oscillator;
pub mod plan;
#[doc(hidden)]
pub mod quadrature;
pub mod report;
pub mod results;
pub mod rig;
#[doc(hidden)]
pub mod roots;
pub mod scales;
pub mod scene;
#[doc(hidden)]
pub mod sparse;
pub mod spectrum;
pub mod stationary;

pub use error::{Error, Result};

/// The code of the README compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// The code of the manual compiles and runs.
#[cfg(doctest)]
#[doc = include_str!("../docs/methods.md")]
struct Methods;
