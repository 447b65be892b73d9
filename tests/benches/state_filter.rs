//! The state filter at full size (52 states, 26 ranges per step) beside the filters of other crates:
//! `cargo bench -p cogmint-tests --bench state_filter`, or with the target's instruction counts
//! `bash tests/filter_benchmark.sh`. Prints a Markdown table; fails where a filter disagrees with the textbook's.
//!
//! Takes pairs `--instructions NAME=COUNT` and `--memory NAME=BYTES` for the columns that only the target knows.

use cogmint_core::perceptor::state_filter::StateFilter;
use cogmint_peer_filters::nalgebra::{DMatrix, DVector};
use cogmint_peer_filters::textbook::Textbook;
use cogmint_peer_filters::{Filter, RANGES, STATES, Scene, kfilter_crate, minikalman_crate};
use cogmint_tests::full_filter::{ANCHORS, ANCHORS_M, MOTION, PRIOR_STD, Problem, RANGE_STD_M, STEP_S, VAS};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

/// Steps of a run.
const STEPS: usize = 100;
/// Runs of every filter; the median of their times counts.
const RUNS: usize = 15;
/// Largest distance of any coordinate from the textbook's filter in f64 after the last step, metres.
const AGREEMENT_M: f64 = 1e-3;

fn main() -> ExitCode {
    // Whole covariances pass through the stack.
    let work = std::thread::Builder::new().stack_size(64 << 20).spawn(compare).expect("a thread");
    work.join().unwrap_or(ExitCode::FAILURE)
}

struct Row {
    name: &'static str,
    title: &'static str,
    start: for<'a> fn(&'a Problem) -> Box<dyn Filter + 'a>,
}

const ROWS: [Row; 6] = [
    Row {
        name: "cogmint",
        title: "cogmint-core, unscented in reduced form",
        start: |problem| Box::new(Core { problem, filter: problem.filter() }),
    },
    Row {
        name: "minikalman-ekf",
        title: "minikalman 0.8, extended",
        start: |problem| Box::new(minikalman_crate::extended(&scene(problem))),
    },
    Row {
        name: "kfilter-ekf",
        title: "kfilter 0.5, extended",
        start: |problem| Box::new(kfilter_crate::Extended::new(&scene(problem))),
    },
    Row {
        name: "kfilter-ukf",
        title: "kfilter 0.5, unscented",
        start: |problem| Box::new(kfilter_crate::Unscented::new(&scene(problem))),
    },
    Row {
        name: "nalgebra-static",
        title: "textbook unscented, nalgebra `SMatrix`",
        start: |problem| Box::new(Textbook::new(&scene(problem))),
    },
    Row {
        name: "nalgebra-dynamic",
        title: "textbook unscented, nalgebra `DMatrix`, f64",
        start: |problem| Box::new(Reference::new(&scene(problem))),
    },
];

fn scene(problem: &Problem) -> Scene {
    let scene = Scene {
        mean: [0.0; STATES],
        variance: [0.0; STATES],
        anchors_m: ANCHORS_M,
        range_variance_m2: RANGE_STD_M * RANGE_STD_M,
        step_s: STEP_S,
        acceleration_density_m2_s3: MOTION.acceleration_density_m2_s3,
        virtual_anchor_walk_m_sqrt_s: MOTION.virtual_anchor_walk_m_sqrt_s,
    };
    let places: [[f32; 2]; VAS] = std::array::from_fn(|slot| problem.surfaces[slot].state);
    scene.started(problem.start_m, PRIOR_STD, &places)
}

fn compare() -> ExitCode {
    let columns = match columns(std::env::args().skip(1)) {
        Ok(columns) => columns,
        Err(error) => {
            eprintln!("state_filter: {error}");
            return ExitCode::from(2);
        }
    };
    let problem = Problem::published(STEPS);
    let mut reference = Reference::new(&scene(&problem));
    problem.ranges_m.iter().for_each(|ranges| reference.step(ranges));
    let [x, y] = problem.truth_m[STEPS - 1];
    let error = (reference.x[0] - x).hypot(reference.x[1] - y);
    assert!(error < 0.1, "the textbook's filter is {error} m off: the comparison must be on a working track");

    let mut times = vec![Vec::new(); ROWS.len()];
    let mut distances = vec![0.0_f64; ROWS.len()];
    for _ in 0..RUNS {
        // In turns, so that whatever else the machine does falls on all of them.
        for ((row, times), distance) in ROWS.iter().zip(&mut times).zip(&mut distances) {
            let mut filter = (row.start)(&problem);
            let begin = Instant::now();
            for ranges in &problem.ranges_m {
                filter.step(black_box(ranges));
            }
            times.push(begin.elapsed().as_secs_f64() * 1e6 / STEPS as f64);
            *distance = coordinates()
                .map(|i| (f64::from(filter.state(i)) - reference.x[i]).abs())
                .fold(0.0, |most, next| if next <= most { most } else { next });
        }
    }
    let medians: Vec<f64> = times
        .iter_mut()
        .map(|times| {
            times.sort_by(f64::total_cmp);
            times[RUNS / 2]
        })
        .collect();

    println!(
        "| 52 states, 26 ranges | host, us per step | ratio | off the f64 textbook, mm | instructions per step, thumbv7em | RAM, bytes |"
    );
    println!("| --- | --- | --- | --- | --- | --- |");
    for ((row, median), distance) in ROWS.iter().zip(&medians).zip(&distances) {
        let told = |column: &str| {
            columns.get(&(column.into(), row.name.into())).map_or("not measured", String::as_str)
        };
        println!(
            "| {} | {median:.1} | {:.1} | {:.3} | {} | {} |",
            row.title,
            median / medians[0],
            distance * 1e3,
            told("--instructions"),
            told("--memory")
        );
    }
    let mut agree = true;
    for (row, distance) in ROWS.iter().zip(&distances) {
        if !(*distance < AGREEMENT_M) {
            eprintln!("state_filter: {} is {:.3} mm off the textbook", row.title, distance * 1e3);
            agree = false;
        }
    }
    if agree { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Columns that the target knows, by option and filter.
fn columns(
    mut arguments: impl Iterator<Item = String>,
) -> Result<BTreeMap<(String, String), String>, String> {
    let mut columns = BTreeMap::new();
    while let Some(option) = arguments.next() {
        if option == "--bench" {
            // Cargo's own.
            continue;
        }
        if !["--instructions", "--memory"].contains(&option.as_str()) {
            return Err(format!("unknown option {option} (known: --instructions, --memory)"));
        }
        let pair = arguments.next().ok_or_else(|| format!("{option} needs NAME=NUMBER"))?;
        let (name, number) = pair.split_once('=').ok_or_else(|| format!("{option} needs NAME=NUMBER"))?;
        if !ROWS.iter().any(|row| row.name == name) {
            return Err(format!("{option}: there is no filter {name}"));
        }
        if !number.parse::<u64>().is_ok_and(|number| number > 0) {
            return Err(format!("{option}: {name} was not measured: {number:?} is no number above 0"));
        }
        columns.insert((option, name.into()), number.into());
    }
    Ok(columns)
}

/// Indices of position and virtual anchors: all but the velocity.
fn coordinates() -> impl Iterator<Item = usize> {
    (0..STATES).filter(|i| ![2, 3].contains(i))
}

/// The core's filter.
struct Core<'a> {
    problem: &'a Problem,
    filter: StateFilter<ANCHORS, VAS>,
}

impl Filter for Core<'_> {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        self.problem.step(&mut self.filter, ranges_m);
    }

    fn state(&self, index: usize) -> f32 {
        match index {
            0 | 1 => self.filter.position_m()[index],
            2 | 3 => self.filter.velocity_m_s()[index - 2],
            _ => self.filter.surface((index - 4) / 2).expect("is mapped").1[index % 2],
        }
    }
}

/// The textbook's unscented filter in f64: points at +-sqrt(n) standard deviations, all of one weight, drawn for the
/// prediction and again for the update.
struct Reference {
    scene: Scene,
    x: DVector<f64>,
    p: DMatrix<f64>,
    noise: DMatrix<f64>,
}

impl Reference {
    fn new(scene: &Scene) -> Self {
        let mut noise = DMatrix::zeros(STATES, STATES);
        scene.each_noise(|row, column, value| noise[(row, column)] = f64::from(value));
        let x = DVector::from_fn(STATES, |i, _| f64::from(scene.mean[i]));
        let p = DMatrix::from_diagonal(&DVector::from_fn(STATES, |i, _| f64::from(scene.variance[i])));
        Self { scene: scene.clone(), x, p, noise }
    }

    fn points(&self) -> DMatrix<f64> {
        let root = self.p.clone().cholesky().expect("positive definite").unpack() * (STATES as f64).sqrt();
        DMatrix::from_fn(STATES, 2 * STATES, |i, point| {
            let offset = root[(i, point % STATES)];
            if point < STATES { self.x[i] + offset } else { self.x[i] - offset }
        })
    }
}

impl Filter for Reference {
    fn step(&mut self, ranges_m: &[f32; RANGES]) {
        let weight = 0.5 / STATES as f64;
        let around = |points: &DMatrix<f64>, mean: &DVector<f64>| {
            let mut around = points.clone();
            around.column_iter_mut().for_each(|mut column| column -= mean);
            around
        };
        let mut points = self.points();
        for mut point in points.column_iter_mut() {
            self.scene.each_transition(|row, column, value| point[row] += f64::from(value) * point[column]);
        }
        self.x = points.column_mean();
        let differences = around(&points, &self.x);
        self.p = &differences * differences.transpose() * weight + &self.noise;

        let points = self.points();
        let images = DMatrix::from_fn(RANGES, points.ncols(), |range, point| {
            let [ax, ay] = match ANCHORS_M.get(range) {
                Some(anchor) => anchor.map(f64::from),
                None => [0, 1].map(|axis| points[(2 * range + axis, point)]),
            };
            (points[(0, point)] - ax).hypot(points[(1, point)] - ay)
        });
        let differences = around(&points, &self.x);
        let expected = images.column_mean();
        let images = around(&images, &expected);
        let variance = f64::from(self.scene.range_variance_m2);
        let pzz = &images * images.transpose() * weight + DMatrix::identity(RANGES, RANGES) * variance;
        let pxz = differences * images.transpose() * weight;
        let gain = pzz.cholesky().expect("positive definite").solve(&pxz.transpose()).transpose();
        let measured = DVector::from_fn(RANGES, |range, _| f64::from(ranges_m[range]));
        self.x += &gain * (measured - expected);
        self.p -= gain * pxz.transpose();
        self.p = (&self.p + self.p.transpose()) * 0.5;
    }

    fn state(&self, index: usize) -> f32 {
        self.x[index] as f32
    }
}
