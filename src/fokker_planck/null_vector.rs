//! The null vector of a generator on a mesh, by inverse iteration.

use super::density::Density;
use super::generator::Generator;
use crate::error::{Error, Result};
use crate::sparse::{Lu, norm, product, shift};
use sprs::CsMat;

/// Change of a solve, in L1, that may be rounding.
const SETTLED: f64 = 1e-9;

/// The null vector of `generator`, positive with mass 1, and its residual |L P|_1/|L|_1; what the last solve changed
/// where that did not settle to rounding.
///
/// Inverse iteration with the shift 1e-10 |L|_1: one LU, a convergence factor below 1e-3 even for
/// decay rates of 1e-7 |L|_1, and a backward error of a few roundings.
///
/// # Errors
/// [`Error::Mesh`] if some cells never exchange probability with the others, so that the null vector
/// would not be unique; [`Error::Linear`] if the iteration changes all of it.
pub fn null_vector(generator: &Generator) -> Result<(Density, f64)> {
    let matrix = generator.matrix();
    check_connected(&matrix)?;
    let n = matrix.cols();
    let norm = norm(&matrix)?;
    let mut shifted = matrix.map(|a| -a);
    shift(&mut shifted, 1e-10 * norm);
    let mut lu = Lu::factor(shifted)?;
    let mut x = vec![1.0 / n as f64; n];
    let mut change = f64::INFINITY;
    // The start is the uniform density: nothing of (21) goes in.
    for _ in 0..40 {
        let before = x.clone();
        lu.solve(&mut x)?;
        let mass: f64 = x.iter().sum();
        for p in &mut x {
            *p /= mass;
        }
        let now = x.iter().zip(&before).map(|(a, b)| (a - b).abs()).sum();
        // Settled when rounding no longer lets the change fall.
        let settled = now < 1e-13 || (now < SETTLED && now > 0.5 * change);
        change = now;
        if settled {
            break;
        }
    }
    if change.is_nan() || change >= 1.0 {
        let what = format!("inverse iteration still changes by {change:.1e} after 40 solves");
        return Err(Error::linear("steady state", what));
    }
    let residual = product(&matrix, &x).iter().map(|r| r.abs()).sum::<f64>() / norm;
    let residual = residual.max(if change > SETTLED { change } else { 0.0 });
    let mut density = Density::from_fn(generator, |_, _| 0.0);
    let number = generator.numbering();
    for (p, unknown) in density.cells_mut().iter_mut().zip(&number) {
        if *unknown != usize::MAX {
            *p = x[*unknown];
        }
    }
    Ok((density, residual))
}

/// Whether every unknown can be reached from every other, by the entries of the generator.
fn check_connected(matrix: &CsMat<f64>) -> Result<()> {
    let reached = |matrix: &CsMat<f64>| {
        let mut seen = vec![false; matrix.cols()];
        let mut queue = vec![0];
        seen[0] = true;
        let mut count = 1;
        while let Some(column) = queue.pop() {
            let Some(entries) = matrix.outer_view(column) else {
                continue;
            };
            for (row, a) in entries.iter() {
                if *a != 0.0 && !seen[row] {
                    seen[row] = true;
                    count += 1;
                    queue.push(row);
                }
            }
        }
        count
    };
    let n = matrix.cols();
    let forward = reached(matrix);
    // The transpose of a matrix by columns is one by rows: turn it back into columns.
    let backward = reached(&matrix.transpose_view().to_csc());
    if forward == n && backward == n {
        return Ok(());
    }
    let fewer = forward.min(backward);
    let what = format!("only {fewer} of {n} cells exchange probability");
    let help = "more cells: the streamlines of this mesh fall into separate parts";
    Err(Error::mesh(what, help))
}
