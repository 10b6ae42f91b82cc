//! The survey as tables, as CSV and as pictures.

use super::cost::{Cost, TIMED, exponent};
use super::entry::{Entry, Survey};
use super::method::Method;
use crate::plot::{Family, Traced, families};
use std::fmt::Write;
use vibroimpact::error::Result;
use vibroimpact::plan::bytes;
use vibroimpact::report::File;

/// Error levels of the tables.
const LEVELS: [f64; 6] = [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/// Methods of a survey in their order.
fn methods(survey: &Survey) -> Vec<Method> {
    let mut all: Vec<Method> = survey.entries.iter().map(|it| it.method).collect();
    all.dedup();
    all
}

fn of(survey: &Survey, method: Method) -> Vec<&Entry> {
    let entries = survey.entries.iter();
    entries.filter(|it| it.method == method).collect()
}

/// The fastest entry with an error of at most `level`.
fn fastest<'a>(
    survey: &'a Survey,
    level: f64,
    error: &dyn Fn(&Entry) -> Option<f64>,
) -> Option<&'a Entry> {
    let good = |it: &&Entry| error(it).is_some_and(|error| error <= level);
    let entries = survey.entries.iter().filter(good);
    entries.min_by(|a, b| a.median().total_cmp(&b.median()))
}

/// Measured order of an error in the cells per direction, or in the number of paths, of the finest
/// three entries that are above what the reference is known to.
fn order(survey: &Survey, method: Method) -> Option<f64> {
    let floor = 3.0 * survey.uncertainty.l1.unwrap_or(0.0);
    let points: Vec<(f64, f64)> = of(survey, method)
        .into_iter()
        .filter(|it| it.main_error() > floor.max(1e-9) && it.main_error() < 0.3)
        .map(|it| {
            let work = if method.samples() {
                it.level.paths as f64
            } else {
                (it.cells[0] as f64 * it.cells[1] as f64).sqrt()
            };
            (work, it.main_error())
        })
        .collect();
    exponent(&points).map(|slope| -slope)
}

/// The tables of the terminal and of precision.md.
pub fn text(surveys: &[Survey], costs: &[Cost]) -> String {
    let mut all = String::new();
    for survey in surveys {
        let _ = writeln!(all, "## {}: {}\n", survey.case.name, survey.case.title);
        let u = &survey.uncertainty;
        let known = if survey.case.is_closed_form() {
            "reference: closed form".to_string()
        } else {
            format!(
                "references: fine runs of two methods, each judging all but its own kind; they differ by {:.1e} in L1, {:.1e} in E[v^2]/T, {:.1e} in E[H]/T, {:.1e} in P(loss): errors of L1 and of E[H] below that are not known",
                u.l1.unwrap_or(0.0),
                u.square_speed,
                u.energy,
                u.loss.unwrap_or(0.0)
            )
        };
        let _ = writeln!(all, "{known}; {:.0} s in all\n", survey.seconds);
        all += "| error | fastest in L1(p) | cells | time | fastest in E[H]/T | cells or paths | time |\n\
                |---|---|---|---|---|---|---|\n";
        for level in LEVELS {
            let side = |it: Option<&Entry>| match it {
                Some(it) => format!("{} | {} | {}", it.method, size(it), time(it)),
                None => "- | - | -".into(),
            };
            let density = fastest(survey, level, &|it| it.errors.l1);
            let energy = fastest(survey, level, &|it| Some(it.errors.energy));
            let (density, energy) = (side(density), side(energy));
            let _ = writeln!(all, "| {level:.0e} | {density} | {energy} |");
        }
        all += "\n| method | order | error, coarse to fine | time | numerical over physical diffusion |\n\
                |---|---|---|---|---|\n";
        for method in methods(survey) {
            let entries = of(survey, method);
            let (Some(first), Some(last)) = (entries.first(), entries.last()) else {
                continue;
            };
            let order = order(survey, method).map_or("-".into(), |it| format!("{it:.1}"));
            let _ = writeln!(
                all,
                "| {method} | {order} | {:.1e} to {:.1e} | {} to {} | {:.1e} to {:.1e} |",
                first.main_error(),
                last.main_error(),
                time(first),
                time(last),
                first.errors.diffusion,
                last.errors.diffusion,
            );
        }
        let mut failed: Vec<Method> = survey.failures.iter().map(|it| it.0).collect();
        failed.dedup();
        for method in failed {
            let levels = || survey.failures.iter().filter(|it| it.0 == method);
            let why = levels().next().map_or("", |it| it.1.as_str());
            let count = match levels().count() {
                1 => "a level".into(),
                many => format!("{many} levels"),
            };
            let _ = writeln!(all, "\n{method}: {count} refused: {why}");
        }
        all.push('\n');
    }
    all += &cost_table(costs);
    all
}

fn cost_table(costs: &[Cost]) -> String {
    let mut all = String::from(
        "## Cost against work\n\nSeconds per unit of simulated time on n x n cells, set-up apart; exponent of n \
         over the last three meshes.\n\n| method | threads | n | set-up | per unit of time | memory | exponent |\n\
         |---|---|---|---|---|---|---|\n",
    );
    let mut threads: Vec<usize> = costs.iter().map(|it| it.threads).collect();
    threads.sort_unstable();
    threads.dedup();
    for (of, _) in TIMED {
        for count in &threads {
            let series: Vec<&Cost> = costs
                .iter()
                .filter(|it| it.of == of && it.threads == *count)
                .collect();
            let points: Vec<(f64, f64)> =
                series.iter().map(|it| (it.n as f64, it.per_unit)).collect();
            for (k, it) in series.iter().enumerate() {
                let fitted = exponent(&points).filter(|_| k + 1 == series.len());
                let _ = writeln!(
                    all,
                    "| {of} | {count} | {} | {} | {} | {} | {} |",
                    it.n,
                    duration(it.setup),
                    duration(it.per_unit),
                    bytes(it.memory),
                    fitted.map_or(String::new(), |it| format!("{it:.2}"))
                );
            }
        }
    }
    all
}

fn size(it: &Entry) -> String {
    if it.method.samples() {
        format!("{:.0e} paths", it.level.paths as f64)
    } else {
        format!("{} x {}", it.cells[0], it.cells[1])
    }
}

/// A time to two or three digits.
fn duration(seconds: f64) -> String {
    if seconds < 1e-3 {
        format!("{:.0} us", seconds * 1e6)
    } else if seconds < 1.0 {
        let digits = usize::from(seconds < 0.01);
        format!("{:.digits$} ms", seconds * 1e3)
    } else {
        format!("{seconds:.1} s")
    }
}

fn time(it: &Entry) -> String {
    duration(it.median())
}

/// precision.csv, cost.csv, precision.md and a picture a case.
pub fn files(surveys: &[Survey], costs: &[Cost]) -> Result<Vec<File>> {
    let head = format!(
        "# Error against run time\n\nMeasured by `cargo run --release --bin lab -- precision`, version {}, on: {}.\nMedians of 3 to 7 runs, of 2 \
         where one takes long; set-up included.\n\n",
        env!("CARGO_PKG_VERSION"),
        machine(),
    );
    let mut files = vec![
        File::text("precision.csv", csv(surveys)),
        File::text("cost.csv", cost_csv(costs)),
        File::text("precision.md", head + &text(surveys, costs)),
    ];
    for survey in surveys {
        files.push(picture(survey)?);
    }
    Ok(files)
}

/// Processor, cores, system.
fn machine() -> String {
    let cpu = std::fs::read_to_string("/proc/cpuinfo")
        .ok()
        .and_then(|text| {
            let line = text.lines().find(|line| line.starts_with("model name"))?;
            Some(line.split(':').nth(1)?.trim().to_string())
        });
    format!(
        "{}, {} threads, {} {}",
        cpu.unwrap_or_else(|| "a processor of unknown name".into()),
        rayon::current_num_threads(),
        std::env::consts::OS,
        std::env::consts::ARCH
    )
}

fn csv(surveys: &[Survey]) -> String {
    let mut all = String::from(
        "case,method,cells q,cells v,unknowns,paths,steps,memory (bytes),time median (s),time fastest (s),\
         time slowest (s),processor time (s),runs,L1 error,E[v^2] error (T),E[H] error (T),P(loss) error,numerical over physical \
         diffusion\n",
    );
    for survey in surveys {
        for it in &survey.entries {
            let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.4e}"));
            let [fast, slow] = it.spread();
            let _ = writeln!(
                all,
                "{},\"{}\",{},{},{},{},{},{},{:.4e},{fast:.4e},{slow:.4e},{:.4e},{},{},{:.4e},{:.4e},{},{:.4e}",
                survey.case.name,
                it.method,
                it.cells[0],
                it.cells[1],
                it.unknowns,
                it.level.paths,
                it.steps,
                it.memory,
                it.median(),
                it.processor,
                it.seconds.len(),
                number(it.errors.l1),
                it.errors.square_speed,
                it.errors.energy,
                number(it.errors.loss),
                it.errors.diffusion,
            );
        }
    }
    all
}

fn cost_csv(costs: &[Cost]) -> String {
    let mut all = String::from(
        "method,threads,n,set-up (s),time per unit of simulated time (s),memory (bytes)\n",
    );
    for it in costs {
        let _ = writeln!(
            all,
            "\"{}\",{},{},{:.4e},{:.4e},{}",
            it.of, it.threads, it.n, it.setup, it.per_unit, it.memory
        );
    }
    all
}

/// Error against time, one row a family of methods.
fn picture(survey: &Survey) -> Result<File> {
    let mut all: Vec<Family> = Vec::new();
    for method in methods(survey) {
        let entries = || of(survey, method).into_iter();
        let density = entries().filter_map(|it| Some((it.median(), it.errors.l1?)));
        let energy = entries().map(|it| (it.median(), it.errors.energy));
        let one = Traced {
            name: method.to_string(),
            points: [density.collect(), energy.collect()],
        };
        let name = method.family();
        match all.iter_mut().find(|it| it.name == name) {
            Some(family) => family.methods.push(one),
            None => all.push(Family {
                name: name.into(),
                methods: vec![one],
            }),
        }
    }
    let name = format!("precision_{}.svg", survey.case.name);
    let labels = ["L1 error of the density", "error of E[H], in T"];
    let x = ("seconds, set-up included", labels);
    families(name, survey.case.title, x, &all)
}
