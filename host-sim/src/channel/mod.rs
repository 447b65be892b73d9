//! The radio channel of a scenario: from walls and radios to samples.
//!
//! For one cycle, anchor and action: the paths (`path`: image sources that are visible, their walls, antennas, people),
//! each with the phasor
//!
//! H_k(f) = sqrt(SNR_1m) (f_0 / f) / d_k G_tx G_rx prod Gamma(f) prod T(f) e^(-j 2 pi f tau_k), f_0 = 7 GHz,
//!
//! the dense multipath of the room and of interferers (`dense_multipath`), and white noise; all of it on a lattice of
//! frequencies (`lattice`), times the pulse's power spectrum (`pulse`): the samples that leave the matched filter. The
//! unit is the standard deviation of the white noise there.
//!
//! Everything random follows from the seed and the indexes of what it is for: a frame does not depend on which frames
//! were asked for before it, nor on the number of threads.

pub mod antenna;
pub mod dense_multipath;
mod interference;
pub mod lattice;
pub mod path;
pub mod person;
pub mod pulse;
pub mod random;
pub mod receiver;
pub mod wall;

use crate::geometry::image_source::{ImageSource, image_sources};
use crate::geometry::trajectory::{self, Pose};
use crate::geometry::{Wall, polygon};
use crate::input_error::InputError;
use crate::scenario::{self, Fading, Room, Scenario, Way, Window, construction};
use dense_multipath::{ProfileTable, Scatterers, View};
use interference::Interferer;
use lattice::{Lattice, Scratch};
use path::PathContext;
use pulse::PulseSpectrum;
use random::{Purpose, complex_normal, stream};
use receiver::Receiver;
use rustfft::num_complex::Complex64;
use std::path::Path;
use wall::{Slab, WallTable};

/// Speed of light, m/s.
pub const SPEED_OF_LIGHT_M_S: f64 = 299_792_458.0;
/// Frequency at which strengths are stated, hertz.
pub const REFERENCE_HZ: f64 = 7e9;
/// Scatterers per pulse duration of delay: enough for their sum to be nearly normal (its power's mean square is 1.85
/// times its squared mean; 2 would be normal).
const SCATTERERS_PER_PULSE: f64 = 8.0;

/// e^(j angle).
pub(crate) fn cis(angle: f64) -> Complex64 {
    let (sin, cos) = libm::sincos(angle);
    Complex64::new(cos, sin)
}

/// Power gain of free space over `range_m` at `frequency_hz`, isotropic antennas (Friis).
pub fn friis(range_m: f64, frequency_hz: f64) -> f64 {
    let amplitude = SPEED_OF_LIGHT_M_S / (4.0 * std::f64::consts::PI * frequency_hz * range_m);
    amplitude * amplitude
}

/// 10^(decibel / 10).
pub(crate) fn power_of(decibel: f64) -> f64 {
    libm::pow(10.0, decibel / 10.0)
}

/// What one action receives: a carrier's band on the lattice.
#[derive(Debug)]
struct Band {
    carrier_hz: f64,
    spectrum: PulseSpectrum,
    /// Lattice point of entry 0, and the one nearest to the carrier.
    first: i64,
    centre: i64,
    /// Entry 0 in the wall tables.
    table: usize,
    /// P times the lattice step.
    pulse: Vec<f64>,
    /// f_0 / f.
    slope: Vec<f64>,
}

/// A path with what the receiver makes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// Index of its image source; 0: the direct path.
    pub source: usize,
    /// Delay of propagation, seconds.
    pub delay_s: f64,
    /// Its response after the matched filter where that is largest, in standard deviations of the noise.
    pub amplitude: Complex64,
    /// Its power over noise, dense multipath and interference at its delay.
    pub sinr: f64,
}

impl Component {
    /// Magnitude of its response at its largest.
    pub fn magnitude(&self) -> f64 {
        self.amplitude.norm_sqr().sqrt()
    }
}

/// The channel between all anchors of a scenario and the tag on one of its trajectories.
pub struct Channel {
    scenario: Scenario,
    receiver: Receiver,
    seed: u64,
    /// Sets the noise of several trajectories apart.
    trajectory: usize,
    walls: Vec<Wall>,
    /// Per construction that occurs.
    tables: Vec<WallTable>,
    /// Per anchor.
    images: Vec<Vec<ImageSource>>,
    poses: Vec<Pose>,
    lattice: Lattice,
    /// Per action.
    bands: Vec<Band>,
    profile: ProfileTable,
    /// Per anchor, unless drawn anew for every frame.
    scatterers: Vec<Scatterers>,
    interferers: Vec<Interferer>,
    /// Least and largest delay that any frame shows, seconds.
    frame_delays_s: [f64; 2],
    /// Centre of the room, and its farthest corner from there, metres.
    centre_m: [f64; 2],
    radius_m: f64,
}

impl Channel {
    /// The channel of `scenario` along its trajectory `trajectory`, with the scenario's seed unless `seed` is given.
    /// `folder` is where recorded trajectories are looked for.
    ///
    /// # Errors
    /// There is no such trajectory, or its file cannot be used.
    pub fn new(
        scenario: &Scenario,
        folder: Option<&Path>,
        trajectory: usize,
        seed: Option<u64>,
    ) -> Result<Self, InputError> {
        let poses = poses(scenario, folder, trajectory)?;
        let mut channel = Self::along(scenario, poses, seed.unwrap_or(scenario.seed))?;
        channel.trajectory = trajectory;
        Ok(channel)
    }

    /// The channel of `scenario` along given poses, of which there must be at least one.
    ///
    /// # Errors
    /// A wall's construction is unknown.
    pub fn along(scenario: &Scenario, poses: Vec<Pose>, seed: u64) -> Result<Self, InputError> {
        let receiver = Receiver::new(&scenario.radio);
        let (walls, slabs) = structure(scenario, &scenario.room)?;
        let longest_s = receiver.actions.iter().map(|action| action.pulse_duration_s).fold(0.0, f64::max);
        let lattice = Lattice::new(receiver.samples, receiver.sample_spacing_s, longest_s);
        let (bands, frequencies_hz) = bands(&receiver, &lattice);
        let polarisation = scenario.propagation.polarisation;
        let tables: Vec<WallTable> = slabs
            .into_iter()
            .map(|slab| WallTable::new(slab, polarisation, frequencies_hz.clone()))
            .collect();
        let order = scenario.propagation.reflection_order;
        let images = scenario.anchors.iter().map(|a| image_sources(&walls, a.position_m, order)).collect();
        let (centre_m, radius_m) = surroundings(&scenario.room.corners_m);
        let mut channel = Self {
            profile: ProfileTable::new(&scenario.dense_multipath.profile),
            scenario: scenario.clone(),
            receiver,
            seed,
            trajectory: 0,
            walls,
            tables,
            images,
            poses,
            lattice,
            bands,
            scatterers: Vec::new(),
            interferers: Vec::new(),
            frame_delays_s: [0.0; 2],
            centre_m,
            radius_m,
        };
        channel.frame_delays_s = channel.frame_delays_s();
        if scenario.dense_multipath.fading == Fading::Correlated {
            let profile = scenario.dense_multipath.profile;
            channel.scatterers = (0..scenario.anchors.len())
                .map(|anchor| channel.scatterers(&[anchor], profile.length_s(), 0.0))
                .collect();
        }
        // Strengths stated as a SINR need the rest of the channel.
        for index in 0..scenario.interference.len() {
            let interferer = Interferer::new(&channel, index)?;
            channel.interferers.push(interferer);
        }
        Ok(channel)
    }

    /// The scenario.
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Its receiver.
    pub fn receiver(&self) -> &Receiver {
        &self.receiver
    }

    /// The seed in use.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Where the tag is in every cycle.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// The walls.
    pub fn walls(&self) -> &[Wall] {
        &self.walls
    }

    /// The image sources of an anchor, as [`Component::source`] counts them; the first is the anchor itself.
    pub fn images(&self, anchor: usize) -> &[ImageSource] {
        &self.images[anchor]
    }

    /// The pulse spectrum of an action.
    pub fn pulse(&self, action: usize) -> &PulseSpectrum {
        &self.bands[action].spectrum
    }

    /// Omega_1 of each interferer over the power of a direct path of 1 m, both at 7 GHz; those stated as a SINR are
    /// worked out.
    pub fn interference_omega_1(&self) -> Vec<f64> {
        let snr_at_1_m = self.snr_at_1_m();
        self.interferers.iter().map(|interferer| interferer.omega / snr_at_1_m).collect()
    }

    /// Cycles `from..to` of a part of the way.
    pub fn cycles_of(&self, part: scenario::Part) -> std::ops::Range<usize> {
        let [from, to] = part.0.map(|share| libm::round(share * self.poses.len() as f64) as usize);
        from..to
    }

    fn snr_at_1_m(&self) -> f64 {
        power_of(self.scenario.noise.snr_at_1_m_db)
    }

    /// Power of the room's dense multipath at 7 GHz over the white noise.
    fn omega(&self) -> f64 {
        self.snr_at_1_m() * power_of(self.scenario.dense_multipath.omega_1_db)
    }

    /// Height of the tag, metres.
    pub fn tag_height_m(&self, cycle: usize) -> f64 {
        self.poses[cycle].height_m.unwrap_or(self.scenario.tag.height_m)
    }

    /// Delay of the straight line between anchor and tag, seconds, whatever is in its way.
    pub fn direct_delay_s(&self, cycle: usize, anchor: usize) -> f64 {
        let [x, y] = self.poses[cycle].position_m;
        let [u, v] = self.scenario.anchors[anchor].position_m;
        let up = self.scenario.anchors[anchor].height_m - self.tag_height_m(cycle);
        ((x - u) * (x - u) + (y - v) * (y - v) + up * up).sqrt() / SPEED_OF_LIGHT_M_S
    }

    /// Least and largest delay that any frame shows, wherever in the room the tag is.
    fn frame_delays_s(&self) -> [f64; 2] {
        let [before_s, after_s] = self.lattice.reach_s();
        let errors = &self.scenario.errors;
        let end_s = self.poses.last().map_or(0.0, |pose| pose.time_s);
        let bias_m = self.scenario.anchors.iter().map(|anchor| anchor.range_bias_m.abs()).fold(0.0, f64::max);
        let late_s = errors.clock_offset_s.abs()
            + errors.clock_drift.abs() * end_s.abs()
            + bias_m / SPEED_OF_LIGHT_M_S
            + 6.0 * errors.timestamp_std_s;
        let [first_s, last_s] = match self.receiver.window {
            Window::Absolute { first_sample_delay_s } => {
                [first_sample_delay_s - late_s, first_sample_delay_s + late_s]
            }
            Window::FirstPath { sample } => {
                let lead_s = (sample + 1) as f64 * self.receiver.sample_spacing_s;
                // The first path may be one of the highest order.
                let legs = (self.scenario.propagation.reflection_order + 1) as f64;
                [-lead_s, legs * 2.0 * self.radius_m / SPEED_OF_LIGHT_M_S]
            }
        };
        [first_s + before_s, last_s + after_s]
    }

    /// Delay of the first path that exists, seconds; where there is none, of the straight line.
    pub fn first_path_s(&self, cycle: usize, anchor: usize) -> f64 {
        let delays = self.paths(cycle, anchor).into_iter().map(|path| path.delay_s());
        delays.reduce(f64::min).unwrap_or_else(|| self.direct_delay_s(cycle, anchor))
    }

    /// Scatterers at every delay that a profile beginning `onset_s` after a direct path and `length_s` long reaches
    /// inside any frame, wherever in the room the tag is: they belong to the room, not to a way through it.
    fn scatterers(&self, stream_of: &[usize], length_s: f64, onset_s: f64) -> Scatterers {
        let crossing_s = 2.0 * self.radius_m / SPEED_OF_LIGHT_M_S;
        let [earliest_s, latest_s] = self.frame_delays_s;
        let turn_s = 0.5 * crossing_s;
        let from_s = onset_s.max(earliest_s) - turn_s;
        let to_s = (crossing_s + onset_s + length_s).min(latest_s) + turn_s;
        let interval_s = [from_s, to_s.max(from_s)];
        let shortest = self.receiver.actions.iter().map(|a| a.pulse_duration_s).fold(f64::INFINITY, f64::min);
        let mut rng = stream(self.seed, Purpose::Scatterers, stream_of);
        Scatterers::new(&mut rng, self.centre_m, interval_s, SCATTERERS_PER_PULSE / shortest)
    }

    /// The paths that exist between an anchor and the tag.
    pub fn paths(&self, cycle: usize, anchor: usize) -> Vec<path::Path> {
        path::paths(&PathContext {
            scenario: &self.scenario,
            walls: &self.walls,
            images: &self.images[anchor],
            anchor,
            pose: &self.poses[cycle],
            tag_height_m: self.tag_height_m(cycle),
            share: cycle as f64 / self.poses.len() as f64,
        })
    }

    /// The paths that an action receives, with their strengths.
    pub fn components(&self, cycle: usize, anchor: usize, action: usize) -> Vec<Component> {
        self.components_of(&self.paths(cycle, anchor), cycle, anchor, action)
    }

    /// The same where the cycle's paths are known already: they do not depend on the action.
    pub fn components_of(
        &self,
        paths: &[path::Path],
        cycle: usize,
        anchor: usize,
        action: usize,
    ) -> Vec<Component> {
        let mut spectrum = Vec::new();
        paths
            .iter()
            .map(|path| {
                self.path_spectrum(path, cycle, &self.bands[action], &mut spectrum);
                self.component(path, &spectrum, [cycle, anchor, action])
            })
            .collect()
    }

    /// Power of noise, dense multipath and interference after the matched filter at a delay.
    pub fn disturbance(&self, cycle: usize, anchor: usize, action: usize, delay_s: f64) -> f64 {
        let band = &self.bands[action];
        let excess_s = delay_s - self.direct_delay_s(cycle, anchor);
        let slope = REFERENCE_HZ / band.carrier_hz;
        let dense = self.omega() * slope * slope * band.spectrum.smeared(&self.profile, excess_s);
        let interference = self.interferers.iter().map(|interferer| {
            interferer.power(anchor, cycle, excess_s, &band.spectrum) * interferer.received_s[action]
        });
        1.0 + dense + interference.sum::<f64>()
    }

    /// What the receiver makes of a path, from its spectrum.
    fn component(
        &self,
        path: &path::Path,
        spectrum: &[Complex64],
        [cycle, anchor, action]: [usize; 3],
    ) -> Component {
        // Over a few lattice points the phase hardly turns: their sums are enough to look around the peak with.
        const TOGETHER: usize = 4;
        let sums: Vec<Complex64> = spectrum.chunks(TOGETHER).map(|chunk| chunk.iter().sum()).collect();
        let band = &self.bands[action];
        let step_hz = TOGETHER as f64 * self.lattice.step_hz();
        let first_hz = self.lattice.frequency_hz(band.first) - band.carrier_hz
            + 0.5 * (TOGETHER - 1) as f64 * self.lattice.step_hz();
        let amplitude_at = |shift_s: f64| {
            let turn = cis(std::f64::consts::TAU * step_hz * shift_s);
            let sum = sums.iter().rev().fold(Complex64::new(0.0, 0.0), |sum, value| sum * turn + value);
            sum * cis(std::f64::consts::TAU * first_hz * shift_s)
        };
        // Layered walls are not mirrors: the response peaks later than the path arrives.
        let shift_s = if path.is_mirrored_unchanged(&self.tables) {
            0.0
        } else {
            peak(|shift_s| amplitude_at(shift_s).norm_sqr(), 0.5 * band.spectrum.duration_s())
        };
        let amplitude = amplitude_at(shift_s);
        let disturbance = self.disturbance(cycle, anchor, action, path.delay_s());
        Component {
            source: path.source(),
            delay_s: path.delay_s(),
            amplitude,
            sinr: amplitude.norm_sqr() / disturbance,
        }
    }

    /// Strength and phase of a path over a band, times the pulse, as if it arrived at the first sample.
    fn path_spectrum(&self, path: &path::Path, cycle: usize, band: &Band, into: &mut Vec<Complex64>) {
        let time_s = self.poses[cycle].time_s;
        let amplitude = self.snr_at_1_m().sqrt()
            * path.gain()
            * path.shadow(&self.scenario.people, time_s, band.carrier_hz);
        // The phase at the carrier; whole turns are left out before the sine.
        let turns = band.carrier_hz * path.delay_s();
        let phasor = cis(-std::f64::consts::TAU * (turns - libm::floor(turns))) * amplitude;
        into.clear();
        into.extend(band.pulse.iter().zip(&band.slope).map(|(pulse, slope)| phasor * (pulse * slope)));
        path.apply_antennas(&self.scenario, into, |n| self.lattice.frequency_hz(band.first + n as i64));
        path.apply_walls(&self.tables, into, band.table);
    }

    /// The samples of a frame whose first sample is at `origin_s` after transmission, in standard deviations of the
    /// white noise. `components` is told every path.
    pub fn samples(
        &self,
        cycle: usize,
        anchor: usize,
        action: usize,
        origin_s: f64,
        scratch: &mut FrameScratch,
        mut components: Option<&mut Vec<Component>>,
    ) -> Vec<Complex64> {
        let band = &self.bands[action];
        let FrameScratch { lattice: grid, total, path: spectrum } = scratch;
        total.clear();
        total.resize(band.pulse.len(), Complex64::new(0.0, 0.0));
        let [earliest_s, latest_s] = self.lattice.reach_s();
        for path in self.paths(cycle, anchor) {
            self.path_spectrum(&path, cycle, band, spectrum);
            if let Some(components) = components.as_deref_mut() {
                components.push(self.component(&path, spectrum, [cycle, anchor, action]));
            }
            let after_first_s = path.delay_s() - origin_s;
            if (earliest_s..latest_s).contains(&after_first_s) {
                // Phase -2 pi (f - carrier) (tau - t_0).
                let offset_hz = self.lattice.frequency_hz(band.first) - band.carrier_hz;
                add_delayed(
                    total,
                    spectrum,
                    offset_hz * after_first_s,
                    self.lattice.step_hz() * after_first_s,
                );
            }
        }
        let view = View {
            position_m: self.poses[cycle].position_m,
            onset_s: self.direct_delay_s(cycle, anchor),
            first_sample_s: origin_s,
            centre_hz: self.lattice.frequency_hz(band.centre),
            carrier_hz: band.carrier_hz,
        };
        let omega = self.omega();
        self.lattice.begin_spread(grid);
        match self.scatterers.get(anchor) {
            Some(scatterers) => scatterers.spread(&self.lattice, grid, &view, omega, &self.profile),
            None => {
                let length_s = self.scenario.dense_multipath.profile.length_s();
                let drawn = self.scatterers(&[anchor, 0, self.trajectory, cycle], length_s, 0.0);
                drawn.spread(&self.lattice, grid, &view, omega, &self.profile);
            }
        }
        let weight = |n: usize| band.pulse[n] * band.slope[n];
        self.lattice.gather(grid, band.first, band.centre, total, weight);
        for (index, interferer) in self.interferers.iter().enumerate() {
            interferer.add(self, index, cycle, anchor, band, &view, grid, total);
        }
        let mut rng = stream(self.seed, Purpose::Noise, &[self.trajectory, cycle, anchor, action]);
        for (total, pulse) in total.iter_mut().zip(&band.pulse) {
            *total += complex_normal(&mut rng) * pulse.sqrt();
        }
        self.lattice.samples(grid, band.first, band.centre, band.carrier_hz, total)
    }
}

/// Adds a spectrum whose entry n is turned back by `first_turns` + n `step_turns` turns. Four phasors go side by side:
/// one would make every entry wait for the one before it.
fn add_delayed(total: &mut [Complex64], spectrum: &[Complex64], first_turns: f64, step_turns: f64) {
    const LANES: usize = 4;
    let back = |turns: f64| cis(-std::f64::consts::TAU * (turns - libm::floor(turns)));
    let mut phasors: [Complex64; LANES] =
        std::array::from_fn(|lane| back(first_turns + lane as f64 * step_turns));
    let step = back(LANES as f64 * step_turns);
    for (total, spectrum) in total.chunks_mut(LANES).zip(spectrum.chunks(LANES)) {
        for ((total, value), phasor) in total.iter_mut().zip(spectrum).zip(&mut phasors) {
            *total += value * *phasor;
            *phasor *= step;
        }
    }
}

/// Buffers of one thread.
#[derive(Default)]
pub struct FrameScratch {
    lattice: Scratch,
    total: Vec<Complex64>,
    path: Vec<Complex64>,
}

/// Where the tag is in every cycle of a trajectory of `scenario`; `folder` is where recorded ones are looked for.
///
/// # Errors
/// There is no such trajectory, or its file cannot be used or leads out of the room.
pub fn poses(scenario: &Scenario, folder: Option<&Path>, trajectory: usize) -> Result<Vec<Pose>, InputError> {
    let Some(way) = scenario.trajectories.get(trajectory) else {
        return Err(InputError::new(&scenario.name, format!("has no trajectory {trajectory}"))
            .allowed(format!("0 to {}", scenario.trajectories.len() - 1)));
    };
    let poses = trajectory::poses(way, folder)?;
    if let Way::Recorded { file } = &way.way {
        stays_inside(&poses, &scenario.room, &folder.unwrap_or(Path::new("")).join(file))?;
    }
    Ok(poses)
}

/// Recorded ways are not part of the scenario's own checks: they must stay inside the room and pass no wall.
fn stays_inside(poses: &[Pose], room: &scenario::Room, file: &Path) -> Result<(), InputError> {
    let walls = scenario::walls(room);
    for (row, pose) in poses.iter().enumerate() {
        let [x, y] = pose.position_m;
        let refuse = |reason: String| {
            InputError::new(file, format!("{reason} in row {}, counted from 1 after the header", row + 1))
                .allowed("positions inside the room, off its walls")
        };
        if !polygon::contains(&room.corners_m, pose.position_m) {
            return Err(refuse(format!("leads out of the room, to ({x}, {y}),")));
        }
        let before_m = poses[row.saturating_sub(1)].position_m;
        let leg = Wall { ends_m: [before_m, pose.position_m], construction: 0 };
        let at_wall = |&(ends_m, _): &([[f64; 2]; 2], &str)| {
            polygon::nearer(&leg, &Wall { ends_m, construction: 0 }, scenario::CLEARANCE_M)
        };
        if walls.iter().any(at_wall) {
            return Err(refuse(format!("leads into or through a wall, to ({x}, {y}),")));
        }
    }
    Ok(())
}

/// The walls of a scenario's room and the slabs that their constructions count.
pub(crate) fn structure(scenario: &Scenario, room: &Room) -> Result<(Vec<Wall>, Vec<Slab>), InputError> {
    let mut names: Vec<&str> = Vec::new();
    let mut slabs = Vec::new();
    let mut walls = Vec::new();
    for (ends_m, name) in construction::walls(room) {
        let construction = match names.iter().position(|known| *known == name) {
            Some(index) => index,
            None => {
                let slab = construction::construction(scenario, name).and_then(|built| {
                    Slab::new(&built, |material| construction::material(scenario, material))
                });
                let Some(slab) = slab else {
                    return Err(InputError::new(&scenario.name, "is no construction").for_item(name));
                };
                names.push(name);
                slabs.push(slab);
                names.len() - 1
            }
        };
        walls.push(Wall { ends_m, construction });
    }
    Ok((walls, slabs))
}

/// The bands of all actions, and the lattice frequencies that the wall tables need: the union of all bands.
fn bands(receiver: &Receiver, lattice: &Lattice) -> (Vec<Band>, Vec<f64>) {
    let spectra: Vec<PulseSpectrum> = receiver
        .actions
        .iter()
        .map(|a| PulseSpectrum::new(&receiver.pulse, a.pulse_duration_s, receiver.sample_spacing_s))
        .collect();
    let ends = |n: usize| {
        let (carrier_hz, half_hz) = (receiver.actions[n].carrier_hz, spectra[n].half_band_hz());
        let first = lattice.nearest(carrier_hz - half_hz);
        // No more points than the period has.
        (first, lattice.nearest(carrier_hz + half_hz).min(first + lattice.widest_band() as i64 - 1))
    };
    let mut points: Vec<i64> = (0..spectra.len()).flat_map(|n| ends(n).0..=ends(n).1).collect();
    points.sort_unstable();
    points.dedup();
    let mut bands = Vec::new();
    for (n, (action, spectrum)) in receiver.actions.iter().zip(&spectra).enumerate() {
        let (first, last) = ends(n);
        let frequencies = || (first..=last).map(|point| lattice.frequency_hz(point));
        bands.push(Band {
            carrier_hz: action.carrier_hz,
            first,
            centre: lattice.nearest(action.carrier_hz),
            table: points.partition_point(|&point| point < first),
            pulse: frequencies().map(|f| spectrum.power(f - action.carrier_hz) * lattice.step_hz()).collect(),
            slope: frequencies().map(|f| REFERENCE_HZ / f).collect(),
            spectrum: spectrum.clone(),
        });
    }
    (bands, points.into_iter().map(|point| lattice.frequency_hz(point)).collect())
}

fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// Centre of a room and its farthest corner from there, metres.
fn surroundings(corners_m: &[[f64; 2]]) -> ([f64; 2], f64) {
    let centre = |axis: usize| {
        let [low, high] = extent(corners_m.iter().map(|corner| corner[axis]));
        0.5 * (low + high)
    };
    let centre_m = [0, 1].map(centre);
    let squared = |corner: &[f64; 2]| {
        let [dx, dy] = [0, 1].map(|axis| corner[axis] - centre_m[axis]);
        dx * dx + dy * dy
    };
    (centre_m, corners_m.iter().map(squared).fold(0.0, f64::max).sqrt())
}

/// Where a smooth single-peaked function is largest within `reach` of zero: five looks, then a parabola through the
/// best and its neighbours.
fn peak(value: impl Fn(f64) -> f64, reach: f64) -> f64 {
    let step = 0.5 * reach;
    let looks: Vec<f64> = (-2..=2).map(|n| value(f64::from(n) * step)).collect();
    let best = (1..4).max_by(|&a, &b| looks[a].total_cmp(&looks[b])).unwrap_or(2);
    let (left, middle, right) = (looks[best - 1], looks[best], looks[best + 1]);
    let bend = left - 2.0 * middle + right;
    let offset = if bend < 0.0 { (0.5 * (left - right) / bend).clamp(-1.0, 1.0) } else { 0.0 };
    (best as f64 - 2.0 + offset) * step
}
