//! A number over the axes of a map.

/// A number over the axes, the last running fastest; NaN where there is none.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Field {
    /// Its words, with its unit.
    pub(crate) label: String,
    /// The numbers.
    pub(crate) values: Vec<f64>,
    /// Their errors.
    pub(crate) errors: Vec<f64>,
    /// A level to be marked.
    pub(crate) level: Option<f64>,
}
