//! Joint maximum a posteriori estimate of a calibration and of what moves: the tag's way where nobody tells it, and the heading
//! of a body with several antennas.
//!
//! range = |x + R(heading) arm - anchor| + bias of the anchor + difference of the antenna + error ([`RangeError`])
//!
//! By Fisher scoring with backtracking: the gradient is that of the one-sided likelihood, the curvature its expected
//! information. What moves is a chain in time (block tridiagonal), the calibration a border that all nodes share; the chain is
//! eliminated node by node, and what is left of the border's information is the posterior's: its inverse holds the
//! deviations, the uncertainty of the way included.
//!
//! A way that is free bends to its ranges: at its most probable, errors would look smaller than they are, and with one range per
//! node vanish. What is maximised is therefore the posterior of the calibration with the way integrated out (Laplace):
//! ln p(calibration, best way) - ln det(information of the way) / 2, by which a range tells of errors only as far as it does not
//! place the tag.

use super::range_error::{PARAMETERS, RangeError, Score};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::f64::consts::TAU;

/// Steps of scoring, at most.
const MOST_STEPS: usize = 200;
/// Halvings of a step, at most.
const MOST_HALVINGS: usize = 12;
/// Steps end where they gain less than this, nats.
const LEAST_GAIN_NAT: f64 = 1e-5;
/// Most that a logarithm or logit moves in a step.
const LONGEST_LOG_STEP: f64 = 0.7;
/// How a body turns: density of a heading's random walk, rad^2/s. The drone of the MILUV flight random_1 has 0.11.
const TURN_DENSITY_RAD2_S: f64 = 0.1;
/// Headings that are compared for a first guess.
const HEADINGS: usize = 48;
/// Deviation of the way's first position and velocity about the first guess, metres and m/s.
const FIRST_STD: [f64; 2] = [5.0, 3.0];
/// Deviations between anchors of the noise's logarithm and of the excess share's logit.
const BETWEEN_ANCHORS: [f64; 2] = [0.3, 0.7];
/// Deviations of what is told of the noise (logarithm), the excess (logarithm), its share (logit) and the false share (logit).
const SHAPE_STD: [f64; 4] = [1.5, 1.0, 1.5, 2.0];
/// Guard: the shortest step of time between nodes, seconds: a motion over less is stiffer than sums in double precision bear.
const SHORTEST_S: f64 = 2e-3;

/// A range as it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observed {
    /// Index of the node that it belongs to.
    pub node: usize,
    /// Index of the anchor.
    pub anchor: usize,
    /// Index of the antenna.
    pub antenna: usize,
    /// The range, metres.
    pub range_m: f64,
    /// Height of the antenna over the anchor, metres.
    pub up_m: f64,
}

/// What is known of a body at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Node {
    /// The time, seconds.
    pub time_s: f64,
    /// Where it is: the truth, or the estimate.
    pub position_m: [f64; 2],
    /// Its velocity, m/s.
    pub velocity_m_s: [f64; 2],
    /// Its heading, rad.
    pub heading_rad: f64,
}

/// How a tag moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Movement {
    /// Density of its white acceleration per axis, m^2/s^3.
    pub density_m2_s3: f64,
    /// Time constant with which its velocity decays, seconds; infinite where it does not.
    pub decay_s: f64,
}

/// One recording's part.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// The nodes in order of time.
    pub nodes: Vec<Node>,
    /// What was measured, in order of the nodes.
    pub observed: Vec<Observed>,
    /// How it moves; none where its positions are the truth.
    pub movement: Option<Movement>,
}

/// What is told beforehand, and in which order the calibration's parameters stand.
#[derive(Clone, Debug, PartialEq)]
pub struct Prior {
    /// Positions of the anchors, metres.
    pub anchors_m: Vec<[f64; 2]>,
    /// Their deviation per axis, metres; 0: they are held.
    pub anchor_std_m: f64,
    /// Mean and deviation of each anchor's bias, metres.
    pub biases_m: Vec<[f64; 2]>,
    /// Deviation of the differences between antennas, metres.
    pub difference_std_m: f64,
    /// Lever arms of the antennas, metres; one of (0, 0) where the tag is its own only antenna.
    pub arms_m: Vec<[f64; 2]>,
    /// What errors look like at first.
    pub error: RangeError,
}

impl Prior {
    fn anchors(&self) -> usize {
        self.anchors_m.len()
    }

    /// Differences between antennas that are free: those of all but the last from their mean.
    fn contrasts(&self) -> usize {
        self.arms_m.len() - 1
    }

    /// Place of an anchor's bias.
    pub fn bias(&self, anchor: usize) -> usize {
        anchor
    }

    /// Place of an antenna's difference from the mean of all.
    pub fn contrast(&self, antenna: usize) -> usize {
        self.anchors() + antenna
    }

    /// Place of an anchor's coordinate.
    pub fn coordinate(&self, anchor: usize, axis: usize) -> usize {
        self.anchors() + self.contrasts() + 2 * anchor + axis
    }

    /// Place of a parameter of all errors: noise, excess, its share, false share.
    pub fn shape(&self, parameter: usize) -> usize {
        let coordinates = if self.anchor_std_m > 0.0 { 2 * self.anchors() } else { 0 };
        self.anchors() + self.contrasts() + coordinates + parameter
    }

    /// Place of what an anchor's noise (0) or excess share (1) differs by.
    fn own(&self, anchor: usize, which: usize) -> usize {
        self.shape(SHAPE_STD.len()) + 2 * anchor + which
    }

    /// Number of parameters.
    pub fn size(&self) -> usize {
        self.own(self.anchors(), 0)
    }

    /// Deviation of a parameter beforehand.
    pub fn std(&self, place: usize) -> f64 {
        let shape = self.shape(0);
        if place < self.anchors() {
            self.biases_m[place][1]
        } else if place < self.anchors() + self.contrasts() {
            self.difference_std_m
        } else if place < shape {
            self.anchor_std_m
        } else if place < shape + SHAPE_STD.len() {
            SHAPE_STD[place - shape]
        } else {
            BETWEEN_ANCHORS[(place - shape - SHAPE_STD.len()) % 2]
        }
    }

    /// Where an anchor is.
    pub fn anchor_m(&self, parameters: &DVector<f64>, anchor: usize) -> [f64; 2] {
        let told_m = self.anchors_m[anchor];
        if self.anchor_std_m == 0.0 {
            return told_m;
        }
        [0, 1].map(|axis| told_m[axis] + parameters[self.coordinate(anchor, axis)])
    }

    /// An antenna's difference from the mean of all, metres.
    pub fn difference_m(&self, parameters: &DVector<f64>, antenna: usize) -> f64 {
        let free = (0..self.contrasts()).map(|free| parameters[self.contrast(free)]);
        if antenna < self.contrasts() { parameters[self.contrast(antenna)] } else { -free.sum::<f64>() }
    }

    /// An anchor's bias, metres.
    pub fn bias_m(&self, parameters: &DVector<f64>, anchor: usize) -> f64 {
        self.biases_m[anchor][0] + parameters[self.bias(anchor)]
    }

    /// What an anchor's errors look like.
    pub fn error(&self, parameters: &DVector<f64>, anchor: usize) -> RangeError {
        let own = [parameters[self.own(anchor, 0)], 0.0, parameters[self.own(anchor, 1)], 0.0];
        let moves = own.into_iter().enumerate().map(|(shape, own)| own + parameters[self.shape(shape)]);
        moves.enumerate().fold(self.error, |error, (shape, by)| error.moved(shape, by))
    }
}

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The parameters, as differences from what was told.
    pub parameters: DVector<f64>,
    /// Their covariance.
    pub covariance: DMatrix<f64>,
    /// Logarithm of the posterior's density, without constants of the priors.
    pub ln_posterior: f64,
    /// Whether the steps came to an end.
    pub converged: bool,
}

/// Which numbers of a node are free, and where they stand in its block.
#[derive(Clone, Copy)]
struct Free {
    moves: bool,
    turns: bool,
}

impl Free {
    fn of(run: &Run, prior: &Prior) -> Self {
        let turns = prior.arms_m.iter().any(|arm_m| *arm_m != [0.0; 2]);
        Self { moves: run.movement.is_some(), turns }
    }

    fn len(self) -> usize {
        4 * usize::from(self.moves) + usize::from(self.turns)
    }

    fn heading(self) -> usize {
        4 * usize::from(self.moves)
    }
}

/// Estimates the calibration; the runs' nodes become the estimated ways.
pub fn estimate(prior: &Prior, runs: &mut [Run]) -> Option<Estimate> {
    let mut parameters = DVector::zeros(prior.size());
    for run in runs.iter_mut() {
        guess_headings(prior, &parameters, run);
    }
    let mut ln_posterior = objective(prior, &parameters, runs);
    let mut converged = false;
    for _ in 0..MOST_STEPS {
        let (step, chains, _) = newton(prior, &parameters, runs)?;
        let steepest = (prior.shape(0)..prior.size()).map(|place| step[place].abs()).fold(0.0, f64::max);
        let mut scale = (LONGEST_LOG_STEP / steepest.max(1e-12)).min(1.0);
        let mut gain_nat = 0.0;
        for _ in 0..MOST_HALVINGS {
            let tried = &parameters + &step * scale;
            let moved: Vec<Run> =
                runs.iter().zip(&chains).map(|(run, chain)| moved(prior, run, chain, scale)).collect();
            let at = objective(prior, &tried, &moved);
            if at > ln_posterior {
                gain_nat = at - ln_posterior;
                (parameters, ln_posterior) = (tried, at);
                runs.clone_from_slice(&moved);
                break;
            }
            scale *= 0.5;
        }
        if gain_nat < LEAST_GAIN_NAT {
            converged = true;
            break;
        }
    }
    let (_, _, covariance) = newton(prior, &parameters, runs)?;
    Some(Estimate { parameters, covariance, ln_posterior, converged })
}

/// A run whose nodes went a part of their step.
fn moved(prior: &Prior, run: &Run, steps: &[DVector<f64>], scale: f64) -> Run {
    let free = Free::of(run, prior);
    let mut moved = run.clone();
    for (node, step) in moved.nodes.iter_mut().zip(steps) {
        if free.moves {
            for axis in 0..2 {
                node.position_m[axis] += scale * step[axis];
                node.velocity_m_s[axis] += scale * step[2 + axis];
            }
        }
        if free.turns {
            node.heading_rad += scale * step[free.heading()];
        }
    }
    moved
}

/// A range as it is expected: its length and its slopes over the antenna's position and over the heading.
fn expected(
    prior: &Prior,
    parameters: &DVector<f64>,
    node: &Node,
    observed: &Observed,
) -> (f64, [f64; 2], f64) {
    let (sin, cos) = node.heading_rad.sin_cos();
    let [along, across] = prior.arms_m[observed.antenna];
    let arm_m = [cos * along - sin * across, sin * along + cos * across];
    let anchor_m = prior.anchor_m(parameters, observed.anchor);
    let [dx, dy] = [0, 1].map(|axis| node.position_m[axis] + arm_m[axis] - anchor_m[axis]);
    let length_m = (dx * dx + dy * dy + observed.up_m * observed.up_m).sqrt().max(1e-6);
    let slope = [dx / length_m, dy / length_m];
    let bias_m = prior.bias_m(parameters, observed.anchor) + prior.difference_m(parameters, observed.antenna);
    (length_m + bias_m, slope, slope[1] * arm_m[0] - slope[0] * arm_m[1])
}

/// The error of a range that this calibration and way would mean, metres.
pub fn error_m(prior: &Prior, parameters: &DVector<f64>, node: &Node, observed: &Observed) -> f64 {
    observed.range_m - expected(prior, parameters, node, observed).0
}

/// Logarithm of the posterior's density, the ways integrated out.
fn objective(prior: &Prior, parameters: &DVector<f64>, runs: &[Run]) -> f64 {
    let errors = errors(prior, parameters);
    let informations: Vec<_> = errors.iter().map(RangeError::information).collect();
    let told: f64 =
        parameters.iter().enumerate().map(|(place, value)| -0.5 * (value / prior.std(place)).powi(2)).sum();
    let of_run = |run: &Run| {
        let free = Free::of(run, prior);
        let heard = run.observed.iter().map(|observed| {
            let error_m = error_m(prior, parameters, &run.nodes[observed.node], observed);
            errors[observed.anchor].score(error_m).ln_density
        });
        let steps = run.nodes.windows(2).map(|pair| {
            let Transition { residual, precision, .. } = transition(free, run, pair);
            -0.5 * residual.dot(&(&precision * &residual))
        });
        let width = Factors::of(way_chain(prior, parameters, run, &informations))
            .map_or(f64::NEG_INFINITY, |factors| -0.5 * factors.ln_determinant());
        heard.sum::<f64>() + steps.sum::<f64>() + width
    };
    told + runs.iter().map(of_run).sum::<f64>()
}

fn errors(prior: &Prior, parameters: &DVector<f64>) -> Vec<RangeError> {
    (0..prior.anchors()).map(|anchor| prior.error(parameters, anchor)).collect()
}

/// How one node follows from the one before.
struct Transition {
    /// The later node's free numbers without what the earlier one's lead to.
    residual: DVector<f64>,
    /// What the earlier one's lead to.
    forward: DMatrix<f64>,
    /// Inverse covariance of the residual.
    precision: DMatrix<f64>,
}

fn transition(free: Free, run: &Run, pair: &[Node]) -> Transition {
    let size = free.len();
    let mut forward = DMatrix::identity(size, size);
    let mut precision = DMatrix::zeros(size, size);
    let mut residual = DVector::zeros(size);
    let (from, to) = (&pair[0], &pair[1]);
    let elapsed_s = (to.time_s - from.time_s).max(SHORTEST_S);
    if let Some(Movement { density_m2_s3, decay_s }) = run.movement {
        let a = 1.0 / decay_s;
        let kept = (-a * elapsed_s).exp();
        // Small rates cancel: then the velocity does not decay within the step.
        let (reach_s, [pp, pv, vv]) = if a * elapsed_s < 1e-3 {
            (elapsed_s, [elapsed_s.powi(3) / 3.0, elapsed_s.powi(2) / 2.0, elapsed_s])
        } else {
            let (once, twice) = ((1.0 - kept) / a, (1.0 - kept * kept) / (2.0 * a));
            (once, [(elapsed_s - 2.0 * once + twice) / (a * a), once * once / 2.0, twice])
        };
        let determinant = pp * vv - pv * pv;
        for axis in 0..2 {
            let velocity = 2 + axis;
            forward[(axis, velocity)] = reach_s;
            forward[(velocity, velocity)] = kept;
            residual[axis] = to.position_m[axis] - from.position_m[axis] - reach_s * from.velocity_m_s[axis];
            residual[velocity] = to.velocity_m_s[axis] - kept * from.velocity_m_s[axis];
            let scale = 1.0 / (determinant * density_m2_s3);
            precision[(axis, axis)] = vv * scale;
            precision[(velocity, velocity)] = pp * scale;
            precision[(axis, velocity)] = -pv * scale;
            precision[(velocity, axis)] = -pv * scale;
        }
    }
    if free.turns {
        let heading = free.heading();
        residual[heading] = to.heading_rad - from.heading_rad;
        precision[(heading, heading)] = 1.0 / (TURN_DENSITY_RAD2_S * elapsed_s);
    }
    Transition { residual, forward, precision }
}

/// Information and gradient of one run's chain.
#[derive(Clone)]
struct Chain {
    diagonal: Vec<DMatrix<f64>>,
    /// Between a node and the next.
    off: Vec<DMatrix<f64>>,
    /// Between a node and the calibration.
    border: Vec<DMatrix<f64>>,
    gradient: Vec<DVector<f64>>,
}

/// A node's or the calibration's number that a range depends on, and how its error parameters do.
type Slope = (usize, [f64; PARAMETERS]);

/// The scoring step of the calibration, those of the nodes by run, and the calibration's covariance.
type Step = (DVector<f64>, Vec<Vec<DVector<f64>>>, DMatrix<f64>);

fn newton(prior: &Prior, parameters: &DVector<f64>, runs: &[Run]) -> Option<Step> {
    let size = prior.size();
    let errors = errors(prior, parameters);
    let informations: Vec<_> = errors.iter().map(RangeError::information).collect();
    let widths: Vec<_> = errors.iter().map(RangeError::precision_slopes).collect();
    let mut core = DMatrix::zeros(size, size);
    let mut core_gradient = DVector::zeros(size);
    for place in 0..size {
        let precision = prior.std(place).powi(-2);
        core[(place, place)] = precision;
        core_gradient[place] = -precision * parameters[place];
    }
    let mut eliminated = Vec::with_capacity(runs.len());
    for run in runs {
        let free = Free::of(run, prior);
        let mut chain = way_chain(prior, parameters, run, &informations);
        let covariances = Factors::of(chain.clone())?.covariances();
        for observed in &run.observed {
            let node = &run.nodes[observed.node];
            let (expected_m, slope, turn) = expected(prior, parameters, node, observed);
            let Score { slopes: score, .. } = errors[observed.anchor].score(observed.range_m - expected_m);
            let information = &informations[observed.anchor];
            let (of_node, mut of_core) = slopes(prior, free, observed, slope, turn);
            // Share of the range that places the tag: it tells less of errors by that much.
            let leverage = leverage(&of_node, covariances.get(observed.node)) * information[0][0];
            for (row, a) in &of_core {
                let of_width = a[1..].iter().zip(&widths[observed.anchor]).map(|(a, w)| a * w).sum::<f64>();
                core_gradient[*row] -= 0.5 * leverage * of_width;
            }
            let product = |a: &[f64; PARAMETERS], b: &[f64; PARAMETERS]| -> f64 {
                a.iter()
                    .zip(information)
                    .map(|(a, row)| a * row.iter().zip(b).map(|(i, b)| i * b).sum::<f64>())
                    .sum()
            };
            let along = |a: &[f64; PARAMETERS]| a.iter().zip(score).map(|(a, s)| a * s).sum::<f64>();
            for (row, a) in &of_core {
                core_gradient[*row] += along(a);
            }
            of_core
                .iter_mut()
                .for_each(|(_, a)| a[1..].iter_mut().for_each(|a| *a *= 1.0 - leverage.min(1.0)));
            for (row, a) in &of_core {
                for (column, b) in &of_core {
                    core[(*row, *column)] += product(a, b);
                }
            }
            for (row, a) in &of_node {
                chain.gradient[observed.node][*row] += along(a);
                for (column, b) in &of_core {
                    chain.border[observed.node][(*row, *column)] += product(a, b);
                }
            }
        }
        eliminated.push(eliminate(chain, &mut core, &mut core_gradient)?);
    }
    let core = Cholesky::new(core)?;
    let step = core.solve(&core_gradient);
    let steps = eliminated.iter().map(|chain| chain.back(&step)).collect();
    Some((step, steps, core.inverse()))
}

/// What a range depends on: numbers of its node, and of the calibration.
fn slopes(
    prior: &Prior,
    free: Free,
    observed: &Observed,
    [ux, uy]: [f64; 2],
    turn: f64,
) -> (Vec<Slope>, Vec<Slope>) {
    // The error falls as what is expected rises.
    let of_length = |slope: f64| [-slope, 0.0, 0.0, 0.0, 0.0];
    let of_error = |parameter: usize| std::array::from_fn(|n| f64::from(u8::from(n == parameter)));
    let mut of_node = Vec::with_capacity(3);
    if free.moves {
        of_node.extend([(0, of_length(ux)), (1, of_length(uy))]);
    }
    if free.turns {
        of_node.push((free.heading(), of_length(turn)));
    }
    let anchor = observed.anchor;
    let mut of_core = vec![(prior.bias(anchor), of_length(1.0))];
    if observed.antenna < prior.contrasts() {
        of_core.push((prior.contrast(observed.antenna), of_length(1.0)));
    } else {
        of_core.extend((0..prior.contrasts()).map(|free| (prior.contrast(free), of_length(-1.0))));
    }
    if prior.anchor_std_m > 0.0 {
        of_core.push((prior.coordinate(anchor, 0), of_length(-ux)));
        of_core.push((prior.coordinate(anchor, 1), of_length(-uy)));
    }
    of_core.extend((0..SHAPE_STD.len()).map(|shape| (prior.shape(shape), of_error(shape + 1))));
    of_core.push((prior.own(anchor, 0), of_error(1)));
    of_core.push((prior.own(anchor, 1), of_error(3)));
    (of_node, of_core)
}

/// The chain of a run with what the ranges say of its nodes, but for gradients and border.
fn way_chain(
    prior: &Prior,
    parameters: &DVector<f64>,
    run: &Run,
    informations: &[[[f64; PARAMETERS]; PARAMETERS]],
) -> Chain {
    let free = Free::of(run, prior);
    let mut chain = motion_chain(prior, free, run);
    if free.len() == 0 {
        return chain;
    }
    for observed in &run.observed {
        let (_, slope, turn) = expected(prior, parameters, &run.nodes[observed.node], observed);
        let (of_node, _) = slopes(prior, free, observed, slope, turn);
        for (row, a) in &of_node {
            for (column, b) in &of_node {
                chain.diagonal[observed.node][(*row, *column)] +=
                    a[0] * b[0] * informations[observed.anchor][0][0];
            }
        }
    }
    chain
}

/// Variance of a range that its node's gives it, square metres.
fn leverage(of_node: &[Slope], covariance: Option<&DMatrix<f64>>) -> f64 {
    let Some(covariance) = covariance else { return 0.0 };
    let rows = of_node.iter().map(|(row, a)| {
        a[0] * of_node.iter().map(|(column, b)| covariance[(*row, *column)] * b[0]).sum::<f64>()
    });
    rows.sum()
}

/// A chain alone, factored.
struct Factors {
    pivots: Vec<Cholesky<f64, Dyn>>,
    off: Vec<DMatrix<f64>>,
}

impl Factors {
    fn of(chain: Chain) -> Option<Self> {
        let Chain { mut diagonal, off, .. } = chain;
        let mut pivots = Vec::with_capacity(diagonal.len());
        if diagonal.first().is_none_or(|block| block.nrows() == 0) {
            return Some(Self { pivots, off });
        }
        for index in 0..diagonal.len() {
            let pivot = Cholesky::new(diagonal[index].clone())?;
            if index + 1 < diagonal.len() {
                let onward = pivot.solve(&off[index]);
                diagonal[index + 1].gemm_tr(-1.0, &off[index], &onward, 1.0);
            }
            pivots.push(pivot);
        }
        Some(Self { pivots, off })
    }

    fn ln_determinant(&self) -> f64 {
        self.pivots.iter().map(|pivot| 2.0 * pivot.l_dirty().diagonal().map(f64::ln).sum()).sum()
    }

    /// Covariance of every node, from the last one on.
    fn covariances(&self) -> Vec<DMatrix<f64>> {
        let mut covariances: Vec<DMatrix<f64>> = Vec::with_capacity(self.pivots.len());
        for (index, pivot) in self.pivots.iter().enumerate().rev() {
            let mut covariance = pivot.inverse();
            if let Some(later) = covariances.last() {
                let onward = pivot.solve(&self.off[index]);
                covariance += &onward * later * onward.transpose();
            }
            covariances.push(covariance);
        }
        covariances.reverse();
        covariances
    }
}

/// The chain of a run before anything was measured.
fn motion_chain(prior: &Prior, free: Free, run: &Run) -> Chain {
    let (size, count) = (free.len(), run.nodes.len());
    let mut chain = Chain {
        diagonal: vec![DMatrix::zeros(size, size); count],
        off: Vec::with_capacity(count),
        border: vec![DMatrix::zeros(size, if size > 0 { prior.size() } else { 0 }); count],
        gradient: vec![DVector::zeros(size); count],
    };
    if size == 0 {
        return chain;
    }
    // About where it is: a limit of the first step, and no more.
    if free.moves {
        for place in 0..4 {
            chain.diagonal[0][(place, place)] += FIRST_STD[place / 2].powi(-2);
        }
    }
    if free.turns {
        chain.diagonal[0][(free.heading(), free.heading())] += TAU.powi(-2);
    }
    for (index, pair) in run.nodes.windows(2).enumerate() {
        let Transition { residual, forward, precision } = transition(free, run, pair);
        let weighted = &precision * &residual;
        let back = forward.transpose() * &precision;
        chain.diagonal[index] += &back * &forward;
        chain.diagonal[index + 1] += &precision;
        chain.off.push(-back);
        chain.gradient[index] += forward.transpose() * &weighted;
        chain.gradient[index + 1] -= weighted;
    }
    chain
}

/// A chain whose nodes are expressed by what comes after them.
struct Eliminated {
    pivots: Vec<Cholesky<f64, Dyn>>,
    chain: Chain,
}

/// Takes a chain out of the equations: what it says of the calibration stays there.
fn eliminate(
    mut chain: Chain,
    core: &mut DMatrix<f64>,
    core_gradient: &mut DVector<f64>,
) -> Option<Eliminated> {
    let mut pivots = Vec::with_capacity(chain.diagonal.len());
    if chain.diagonal.first().is_none_or(|block| block.nrows() == 0) {
        return Some(Eliminated { pivots, chain });
    }
    for index in 0..chain.diagonal.len() {
        let pivot = Cholesky::new(chain.diagonal[index].clone())?;
        let border = chain.border[index].clone();
        let gradient = chain.gradient[index].clone();
        let solved = pivot.solve(&border);
        core.gemm_tr(-1.0, &border, &solved, 1.0);
        core_gradient.gemv_tr(-1.0, &solved, &gradient, 1.0);
        if index + 1 < chain.diagonal.len() {
            let off = chain.off[index].clone();
            let onward = pivot.solve(&off);
            chain.diagonal[index + 1].gemm_tr(-1.0, &off, &onward, 1.0);
            chain.border[index + 1].gemm_tr(-1.0, &onward, &border, 1.0);
            chain.gradient[index + 1].gemv_tr(-1.0, &onward, &gradient, 1.0);
        }
        pivots.push(pivot);
    }
    Some(Eliminated { pivots, chain })
}

impl Eliminated {
    /// The nodes' steps, given the calibration's.
    fn back(&self, step: &DVector<f64>) -> Vec<DVector<f64>> {
        let mut steps: Vec<DVector<f64>> = Vec::with_capacity(self.pivots.len());
        for (index, pivot) in self.pivots.iter().enumerate().rev() {
            let mut right = &self.chain.gradient[index] - &self.chain.border[index] * step;
            if let Some(later) = steps.last() {
                right -= &self.chain.off[index] * later;
            }
            steps.push(pivot.solve(&right));
        }
        steps.reverse();
        if steps.is_empty() { vec![DVector::zeros(0); self.chain.diagonal.len()] } else { steps }
    }
}

/// The most probable headings among a few, by dynamic programming (Viterbi 1967): where scoring starts.
fn guess_headings(prior: &Prior, parameters: &DVector<f64>, run: &mut Run) {
    if !Free::of(run, prior).turns {
        return;
    }
    let errors = errors(prior, parameters);
    let width_rad = TAU / HEADINGS as f64;
    let mut heard = vec![[0.0; HEADINGS]; run.nodes.len()];
    for observed in &run.observed {
        for (bin, ln_density) in heard[observed.node].iter_mut().enumerate() {
            let node = Node { heading_rad: width_rad * bin as f64, ..run.nodes[observed.node] };
            let error_m = error_m(prior, parameters, &node, observed);
            *ln_density += errors[observed.anchor].score(error_m).ln_density;
        }
    }
    let mut best = heard.first().copied().unwrap_or([0.0; HEADINGS]);
    let mut from = vec![[0_usize; HEADINGS]; run.nodes.len()];
    for index in 1..run.nodes.len() {
        let elapsed_s = run.nodes[index].time_s - run.nodes[index - 1].time_s;
        let variance = TURN_DENSITY_RAD2_S * elapsed_s + width_rad * width_rad / 12.0;
        let earlier = best;
        for (to, best) in best.iter_mut().enumerate() {
            let cost = |bin: usize| {
                let apart = to.abs_diff(bin);
                let turn_rad = width_rad * apart.min(HEADINGS - apart) as f64;
                earlier[bin] - 0.5 * turn_rad * turn_rad / variance
            };
            let most = (0..HEADINGS).max_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(0);
            from[index][to] = most;
            *best = cost(most) + heard[index][to];
        }
    }
    let mut bin = (0..HEADINGS).max_by(|a, b| best[*a].total_cmp(&best[*b])).unwrap_or(0);
    let mut after_rad: Option<f64> = None;
    for index in (0..run.nodes.len()).rev() {
        let here_rad = width_rad * bin as f64;
        // The turn from one to the next is the shorter one.
        let turned = after_rad.map_or(0.0, |after_rad| ((after_rad - here_rad) / TAU).round() * TAU);
        run.nodes[index].heading_rad = here_rad + turned;
        after_rad = Some(here_rad + turned);
        bin = from[index][bin];
    }
}
