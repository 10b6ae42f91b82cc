//! A curve as the results hold it.

use crate::estimate::Estimate;
use crate::json::Json;

/// `{"value": [...], "error": [...]}`.
pub(super) fn curve(points: impl Iterator<Item = Option<Estimate>>) -> Json {
    // Where there is no value there is no error either.
    let pair = |it: Option<Estimate>| {
        let it = it.filter(|it| it.value.is_finite());
        it.map_or((f64::NAN, f64::NAN), |it| (it.value, it.error))
    };
    let (values, errors): (Vec<f64>, Vec<f64>) = points.map(pair).unzip();
    Json::object([
        ("value", Json::numbers(values)),
        ("error", Json::numbers(errors)),
    ])
}
