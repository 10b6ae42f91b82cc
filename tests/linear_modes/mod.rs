//! Eigenvalues of the Fokker-Planck operator of G = q in closed form.

/// -zeta (m + n) + i sqrt(1 - zeta^2) (m - n), the slowest first, each pair once.
pub fn linear(zeta: f64, most: i32) -> Vec<(f64, f64)> {
    let mut exact = Vec::new();
    for m in 0..most {
        for n in 0..most {
            let (sum, difference) = (f64::from(m + n), f64::from(m - n));
            if zeta < 1.0 && m >= n && m > 0 {
                exact.push((-zeta * sum, (1.0 - zeta * zeta).sqrt() * difference));
            } else if zeta >= 1.0 && m + n > 0 {
                let root = (zeta * zeta - 1.0).sqrt();
                // zeta - root without cancellation.
                let (slow, fast) = (1.0 / (zeta + root), zeta + root);
                exact.push((-slow * f64::from(m) - fast * f64::from(n), 0.0));
            }
        }
    }
    exact.sort_by(|a, b| b.0.total_cmp(&a.0));
    exact
}
