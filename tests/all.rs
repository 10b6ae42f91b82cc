//! The tests in one program: built and linked once, and no core waits for the end of a file. Beside it stand `allocation`, which
//! counts what the whole program allocates, and `limits`, which looks at the clock.
//!
//! ```sh
//! cargo test --release --test all flow_map::     # the tests of one file
//! ```

mod agreement;
mod arguments;
mod closed_form;
mod concentrated;
mod conservation;
mod convergence;
mod damping;
mod docs;
mod driven;
mod eigenvalues;
mod examples;
mod first_hour;
mod flow_map;
mod hermite;
mod laws;
mod layers;
mod losses;
mod map;
mod mesh_modes;
mod moving;
mod passage;
mod plan;
mod references;
mod runge_kutta;
mod sampling;
mod scenes;
mod spectra;
mod time;
mod tolerance;
