//! Conventions: units, noise, spectra, errors. A page without code.
//!
//! # Units
//!
//! Everything is dimensionless, (6)-(8):
//!
//! | symbol | meaning | unit |
//! |---|---|---|
//! | q | displacement from the static equilibrium, positive into the contact | 2/3 of the static compression z_s |
//! | t | time; the paper's tau | 1/Omega, so that a period of small motion is 2 pi |
//! | v | velocity dq/dt | (2/3) z_s Omega |
//! | omega | circular frequency | Omega: small motion has omega = 1 |
//! | N = G(q) | dynamic contact force, static load left out; -1 out of contact | static load F_s |
//! | H = v^2/2 + U(q) | energy, U(0) = 0 | |
//! | zeta | damping ratio | |
//! | h | level of the noise, below | |
//! | T = pi h/(2 zeta) | temperature: the one parameter of the stationary law | that of v^2 |
//!
//! A [`crate::rig::Rig`] converts to newtons, metres, hertz and seconds.
//!
//! # Noise
//!
//! `E f(t) f(t + s) = 2 pi h delta(s)`: h is the two-sided density per unit of circular frequency, and the
//! one-sided density is 2h. In (17) the noise appears as the diffusion coefficient pi h along v. A measured
//! force density G_0 in N^2/Hz, one-sided, is h = f_0 G_0/(2 F_s^2), (14): key `oscillator.force_psd`.
//!
//! The paper's sum of cosines (31)-(33), as printed, has neither unit variance nor independent phases: (33)
//! lacks the logarithm of the Box-Muller formula and puts it into a phase. Here its evident intent is
//! implemented, f = A sum_k cos(w_k t + phi_k) with A = 2 sqrt(h w_max/M), phases uniform in [0, 2 pi] and
//! frequencies uniform in ]0, w_max] (Shinozuka and Jan, J. Sound Vib. 25, 111, 1972): two-sided density h up
//! to w_max.
//!
//! # Spectra
//!
//! One-sided densities over circular frequency: `S(omega) = (1/pi) integral_{-inf}^{inf} R(tau)
//! exp(-i omega tau) dtau` for omega >= 0, R the autocovariance, so that `integral_0^inf S domega` is the
//! variance. With it the spectrum of the excitation is 2h, and that of N at omega = 0 is 2h too.
//!
//! # Shapes
//!
//! Skewness is E[(N - E N)^3]/std^3; kurtosis E[(N - E N)^4]/std^4, 3 for a Gaussian. Densities p[q, v] are
//! per unit of q and v, cell averages at cell centres, q along rows.
//!
//! # Errors
//!
//! Every computed number is an [`crate::estimate::Estimate`], value ± error.
//!
//! - Closed forms: the bound of the quadrature and of rounding.
//! - Fokker-Planck: a bound that the true error is meant to stay below: from a second mesh, from the steps,
//!   from what the box leaves out. A tolerance is relative to the natural scale of a number
//!   ([`crate::scales::Scales`]).
//! - Monte Carlo: one standard error. Batch means for records, independent paths for ensembles.
//!
//! `agreement` is the largest |a - b|/sqrt(standard error^2 + error^2) over all numbers that both ways give,
//! beside the largest that chance alone would give over as many independent ones.
