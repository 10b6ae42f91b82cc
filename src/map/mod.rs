//! A scene at every point of a grid: axes, points, parts that need no coordination, and what they join to.
//!
//! ```
//! use vibroimpact::map::{Axis, Map};
//! let scene = "[oscillator]\nzeta = 0.005\nh = 1e-3";
//! let axes = vec![Axis::parse("oscillator.h=log:1e-4:1e-2:3")?];
//! let map = Map::of("a.toml", scene, &[], axes, Vec::new())?;
//! assert_eq!(map.len(), 3);
//! assert_eq!(map.scene(1)?.oscillator.h(), 1e-3);
//! assert!(map.line(1)?.starts_with("{\"index\":1,"));
//! # Ok::<(), vibroimpact::map::MapError>(())
//! ```

mod axis;
mod collect;
mod collected;
mod grid;
mod lines;
mod numbers;
mod page;
mod part;
mod run;
mod table;
mod units;

pub use axis::{Axis, Spacing};
pub use collect::{Drawn, collect};
pub use collected::Collected;
pub use grid::{Map, MapError};
pub use part::Part;
pub use run::{Progress, Tally, Watch};
