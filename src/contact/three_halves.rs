//! The power 3/2 of a Hertzian contact, without cancellation at its equilibrium.

/// y = sqrt(1 + x) and y - 1, x >= -1.
#[inline(always)]
pub(super) fn root(x: f64) -> [f64; 2] {
    let y = (1.0 + x).sqrt();
    [y, x / (1.0 + y)]
}

/// (1 + x)^(3/2) - 1 = (y - 1)(1 + y + y^2), x >= -1.
#[inline(always)]
pub(super) fn less_one(x: f64) -> f64 {
    let [y, e] = root(x);
    e * (1.0 + y + y * y)
}
