//! Error against run time: every scheme on every case, against closed forms or against a finer run of
//! another method, with set-up included in every time. And error bars against stored truths:
//! [`calibration`].
//!
//! ```
//! use vibroimpact::precision::{Effort, Method, cases, survey};
//!
//! let linear = cases()?.into_iter().find(|case| case.name == "linear").unwrap();
//! let survey = survey(&linear, &Method::all(&linear)[..1], Effort::Quick, &|_entry| ())?;
//! assert!(survey.entries.iter().all(|it| it.errors.energy.is_finite()));
//! # Ok::<(), vibroimpact::Error>(())
//! ```

pub mod calibration;
mod case;
mod clock;
mod cost;
mod entry;
mod method;
pub mod rates;
mod reference;
mod solve;
mod space;
mod table;
pub mod truths;

pub use case::{Case, cases};
pub use cost::{Cost, CostOf, costs};
pub use entry::{Effort, Entry, Survey, survey};
pub use method::{Level, Method};
pub use reference::{Errors, Reference};
pub use space::{SpaceOrder, space_orders};
pub use table::{files, text};
