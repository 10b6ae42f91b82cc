//! The density p(q, v) with its marginals, snapshots on one sheet, the steady state.

use super::canvas::{
    Area, BLUE, CENTRED, Drawn, GREY, HALO, Hang, INK, LEVELS, Picture, Points, SMALL, TITLE,
    dashed, picture, rectangle, write,
};
use super::contours;
use super::legend::{Mark, legend};
use super::panel::{Panel, highest, range};
use crate::error::Result;
use crate::fokker_planck::Snapshot;
use crate::format::{bare, brief};
use crate::report::File;
use crate::results::{Law, Results};
use rayon::prelude::*;

/// A snapshot with its marginals, ready to be drawn.
pub(super) struct Sheet<'a> {
    snapshot: &'a Snapshot,
    pub(super) q: Vec<f64>,
    v: Vec<f64>,
    pub(super) p_q: Vec<f64>,
    p_v: Vec<f64>,
    peak: f64,
}

impl<'a> Sheet<'a> {
    /// None for a density that is nowhere positive or not on a mesh.
    pub(super) fn of(snapshot: &'a Snapshot) -> Option<Self> {
        let (q, v) = (snapshot.q.to_vec(), snapshot.v.to_vec());
        let fits = snapshot.p.dim() == (q.len(), v.len()) && q.len() > 1 && v.len() > 1;
        let peak = highest(snapshot.p.iter().copied());
        if !fits || peak <= 0.0 {
            return None;
        }
        let [dq, dv] = snapshot.cell_widths();
        let sum =
            |p: ndarray::ArrayView1<'_, f64>, w: &[f64]| p.iter().zip(w).map(|(p, w)| p * w).sum();
        let p = &snapshot.p;
        let p_q = p.rows().into_iter().map(|row| sum(row, &dv)).collect();
        let p_v = p.columns().into_iter().map(|it| sum(it, &dq)).collect();
        Some(Self {
            snapshot,
            q,
            v,
            p_q,
            p_v,
            peak,
        })
    }

    /// The part of the plane where there is anything to see.
    fn window(&self) -> ((f64, f64), (f64, f64)) {
        let seen = |p: &[f64], x: &[f64]| {
            let most = p.iter().copied().fold(0.0, f64::max);
            let there = p.iter().zip(x).filter(|(p, _)| **p > 1e-3 * most);
            range(there.map(|it| *it.1), 0.08).unwrap_or((x[0], x[x.len() - 1]))
        };
        (seen(&self.p_q, &self.q), seen(&self.p_v, &self.v))
    }

    /// Filled levels.
    fn fill(&self, area: &Area<'_>, panel: &Panel) -> Drawn {
        let p = |i: usize, j: usize| self.snapshot.p[[i, j]] / self.peak;
        contours::fill(area, panel, &LEVELS, (&self.q, &self.v), p, 0.0)
    }
}

/// The key to the levels.
fn key(area: &Area<'_>, (x, y): (f64, f64)) -> Drawn {
    write(area, "p / peak", (x, y), (12.5, Hang::Left, INK))?;
    for (k, (level, colour)) in LEVELS.iter().rev().enumerate() {
        let top = y + 10.0 + 11.0 * k as f64;
        let corners = [(x, top), (x + 20.0, top + 11.0)];
        rectangle(area, corners, *colour, Some(GREY))?;
        write(area, &level.to_string(), (x + 27.0, top + 5.5), SMALL)?;
    }
    Ok(())
}

/// One density with its marginals against the closed form.
fn density_picture(name: String, title: &str, snapshot: &Snapshot, results: &Results) -> Picture {
    let sheet = Sheet::of(snapshot)?;
    let law = results.law();
    let (x, y) = sheet.window();
    let main = Panel::new([92.0, 156.0, 430.0, 330.0], x, y);
    let curve =
        |xs: &[f64], ps: &[f64]| -> Points { xs.iter().copied().zip(ps.iter().copied()).collect() };
    let fine =
        |(low, high): (f64, f64)| (0..=300).map(move |k| low + (high - low) * f64::from(k) / 300.0);
    let (by_q, by_v) = (curve(&sheet.q, &sheet.p_q), curve(&sheet.v, &sheet.p_v));
    let exact = |f: &dyn Fn(&Law, f64) -> f64, x: (f64, f64)| -> Points {
        law.iter()
            .flat_map(|law| fine(x).map(move |x| (x, f(law, x))))
            .collect()
    };
    let (exact_q, exact_v) = (exact(&Law::density_q, x), exact(&Law::density_v, y));
    let top = |a: &Points, b: &Points| {
        let most = highest(a.iter().chain(b).map(|(_, p)| *p));
        (0.0, 1.08 * most.max(1e-300))
    };
    let above = Panel {
        top: 44.0,
        height: 104.0,
        y: top(&by_q, &exact_q),
        ..main.clone()
    };
    let beside = Panel {
        left: 544.0,
        width: 104.0,
        x: top(&by_v, &exact_v),
        ..main.clone()
    };
    Some(picture(name, (730, 546), |area| {
        above.title(area, title)?;
        above.axes(area, "", "p(q)")?;
        above.curve(area, &exact_q, HALO, 5.0)?;
        above.curve(area, &by_q, BLUE, 1.5)?;
        above.frame(area)?;
        beside.axes(area, "p(q\u{307})", "")?;
        let turned = |points: &Points| points.iter().map(|(v, p)| (*p, *v)).collect::<Points>();
        beside.curve(area, &turned(&exact_v), HALO, 5.0)?;
        beside.curve(area, &turned(&by_v), BLUE, 1.5)?;
        beside.frame(area)?;
        main.axes(area, "q", "q\u{307}")?;
        sheet.fill(area, &main)?;
        loss_line(area, &main, results, true)?;
        loss_line(area, &above, results, false)?;
        main.frame(area)?;
        key(area, (666.0, 168.0))?;
        legend(area, (554.0, 62.0), BLUE, Mark::Line, "on the mesh")?;
        if law.is_some() {
            legend(area, (554.0, 84.0), HALO, Mark::Halo, "stationary law")?;
        }
        Ok(())
    }))
}

/// The displacements at which contact is lost, on either side of a gap.
fn loss_line(area: &Area<'_>, panel: &Panel, results: &Results, words: bool) -> Drawn {
    let contact = results.contact();
    let ends = contact.loss_point().into_iter().chain(contact.back_wall());
    for (k, loss) in ends.enumerate() {
        if !(loss > panel.x.0 && loss < panel.x.1) {
            continue;
        }
        let ends = [panel.y.0, panel.y.1].map(|y| panel.at(loss, y));
        dashed(area, &ends, GREY, 1.0)?;
        let x = ends[0].0;
        if words && k == 0 && x > panel.left + 70.0 {
            let (at, font) = ((x - 5.0, panel.top + 11.0), (11.5, Hang::Right, GREY));
            write(area, "contact lost", at, font)?;
        }
    }
    Ok(())
}

/// `density_<t>.svg` for every density asked for, on all threads.
pub(crate) fn densities(results: &Results) -> Result<Vec<File>> {
    let unit = results.scene.clock().suffix();
    let densities = results
        .transient
        .as_ref()
        .map_or(&[][..], |it| &it.densities);
    let files = densities.par_iter().filter_map(|snapshot| {
        let name = format!("density_{}.svg", bare(snapshot.t));
        let title = format!("p(q, q\u{307}) at t = {}{unit}", brief(snapshot.t));
        density_picture(name, &title, snapshot, results)
    });
    files.collect()
}

/// snapshots.svg: up to nine of them on one sheet.
pub(crate) fn snapshots(results: &Results) -> Picture {
    let unit = results.scene.clock().suffix();
    let label = |it: &Snapshot| format!("t = {}{unit}", brief(it.t));
    let all = &results.transient.as_ref()?.densities;
    sheet(results, ("snapshots.svg", "p(q, q\u{307})"), all, &label)
}

/// stroboscopic.svg: the periodic law at phases of the drive, on one sheet.
pub(crate) fn stroboscopic(results: &Results) -> Picture {
    let it = results.periodic.as_ref()?;
    let drive = results.scene.excitation.drive?;
    let period = results.scene.clock().time(drive.period());
    let turns = |it: &Snapshot| bare((1e4 * it.t / period).round() / 1e4);
    let label = |it: &Snapshot| format!("{} of a period", turns(it));
    let title = "p(q, q\u{307}) over the phase of the drive";
    sheet(results, ("stroboscopic.svg", title), &it.densities, &label)
}

/// Several densities on one sheet, on the same axes, each to its own peak.
fn sheet(
    results: &Results,
    (file, heading): (&str, &str),
    all: &[Snapshot],
    label: &dyn Fn(&Snapshot) -> String,
) -> Picture {
    let each = all.len().div_ceil(9).max(1);
    let last_on = all.iter().rev().step_by(each);
    let mut sheets: Vec<Sheet<'_>> = last_on.filter_map(Sheet::of).collect();
    sheets.reverse();
    if sheets.len() < 2 {
        return None;
    }
    let (mut ends_q, mut ends_v) = (Vec::new(), Vec::new());
    for (q, v) in sheets.iter().map(Sheet::window) {
        ends_q.extend([q.0, q.1]);
        ends_v.extend([v.0, v.1]);
    }
    let (x, y) = (range(ends_q, 0.0)?, range(ends_v, 0.0)?);
    let columns = if sheets.len() == 4 {
        2
    } else {
        sheets.len().min(3)
    };
    let rows = sheets.len().div_ceil(columns);
    let (width, height) = (236.0, 190.0);
    let size = (
        (86.0 + columns as f64 * (width + 18.0) + 74.0) as u32,
        (36.0 + rows as f64 * (height + 26.0) + 40.0) as u32,
    );
    Some(picture(file, size, |area| {
        write(area, heading, (86.0, 18.0), TITLE)?;
        for (k, sheet) in sheets.iter().enumerate() {
            let (row, column) = (k / columns, k % columns);
            let left = 86.0 + column as f64 * (width + 18.0);
            let top = 52.0 + row as f64 * (height + 26.0);
            let panel = Panel::new([left, top, width, height], x, y);
            let lowest = k + columns >= sheets.len();
            let q = if lowest { "q" } else { "" };
            let v = if column == 0 { "q\u{307}" } else { "" };
            panel.axes(area, q, v)?;
            sheet.fill(area, &panel)?;
            loss_line(area, &panel, results, false)?;
            panel.frame(area)?;
            let title = label(sheet.snapshot);
            let middle = panel.left + 0.5 * width;
            write(area, &title, (middle, panel.top - 10.0), CENTRED)?;
        }
        key(area, (86.0 + columns as f64 * (width + 18.0), 62.0))
    }))
}

/// steady.svg: the steady state on the mesh.
pub(crate) fn steady(results: &Results) -> Picture {
    let it = results.steady.as_ref()?;
    let ([nq, nv], law, apart) = (it.method.cells, results.known_law(), it.l1_error.value);
    let title = format!(
        "Stationary p(q, q\u{307}) on {nq} \u{d7} {nv} cells, L\u{b9} distance to the {law} {apart:.0e}"
    );
    density_picture("steady.svg".into(), &title, &it.density, results)
}
