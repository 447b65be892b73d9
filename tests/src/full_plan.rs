//! The planning problem at full size: 20 of 40 actions, two physical and 24 virtual anchors, all of which are expected to
//! be seen, with SINRs from -5 to 30 dB.

use cogmint_core::Config;
use cogmint_core::config::Radio;
use cogmint_core::controller::planning::{Horizon, LONGEST_HORIZON, Planner, PlanningState, Visible};
use cogmint_core::controller::reward::Reward;
use cogmint_core::information::fisher::PositionInformation;
use cogmint_core::memory::channel::{ChannelMemory, ChannelMemorySettings};
use cogmint_core::model::motion::Motion;
use cogmint_core::model::source::Source;
use cogmint_core::nalgebra::{Matrix2, Matrix4};
use cogmint_core::radio::library::{LIBRARY_WIDE, Library};
use cogmint_core::radio::pulse::PulseShape;
use cogmint_core::trace::TraceHash;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Physical anchors.
pub const ANCHORS: usize = 2;
/// Virtual anchors.
pub const VAS: usize = 24;
/// Actions.
pub const ACTIONS: usize = 40;
/// Horizons planned, cycles.
pub const HORIZONS: [usize; 2] = [1, 5];

/// A source, its map covariance (xx, yx, yy; square metres) and its SINR at every action.
pub struct Seen {
    /// Position, metres.
    pub position_m: [f32; 2],
    /// Covariance of it, square metres.
    pub covariance_m2: [f32; 3],
    /// SINR (linear) by action.
    pub sinr: [f32; ACTIONS],
}

/// Where the tag is: position (m), velocity (m/s), their variances, the cycle's length (s), the deviation of the
/// acceleration (m/s^2), the inflation of variances, the range floor (m), the pulse's roll-off, the threshold.
const OUTLOOK: [f32; 14] = [3.0, 6.0, 0.3, -0.1, 4e-4, 4e-4, 1e-3, 1e-3, 0.1, 0.3, 1.44, 2e-3, 0.6, 6.3];

/// The problem.
pub struct Problem {
    /// The sources: physical anchors first.
    pub sources: Vec<Seen>,
}

impl Problem {
    /// The one problem there is.
    pub fn new() -> Self {
        let mut rng = Xoshiro128PlusPlus::seed_from_u64(26);
        let mut uniform = || (rng.next_u32() >> 8) as f32 / 16_777_216.0;
        let sources = (0..ANCHORS + VAS).map(|index| {
            let std_m = if index < ANCHORS { 0.0 } else { 0.01 + 0.05 * uniform() };
            Seen {
                position_m: [30.0 * uniform() - 12.0, 30.0 * uniform() - 10.0],
                covariance_m2: [std_m * std_m, 0.2 * std_m * std_m, 0.7 * std_m * std_m],
                sinr: std::array::from_fn(|_| 10_f32.powf(-0.5 + 3.5 * uniform())),
            }
        });
        Self { sources: sources.collect() }
    }

    /// As the firmware's `planning` reads it.
    pub fn feed(&self) -> Vec<u8> {
        let mut bytes = b"COGP".to_vec();
        OUTLOOK.iter().for_each(|float| bytes.extend(float.to_le_bytes()));
        for source in &self.sources {
            let floats = source.position_m.iter().chain(&source.covariance_m2).chain(&source.sinr);
            floats.for_each(|float| bytes.extend(float.to_le_bytes()));
        }
        bytes
    }

    /// Hash over the rewards of a horizon, as the firmware computes it.
    pub fn hash(&self, steps: usize) -> u64 {
        let library = Library::<ACTIONS>::new(&LIBRARY_WIDE).expect("is valid");
        let mut memory = ChannelMemory::<ANCHORS, VAS, ACTIONS>::new(
            ChannelMemorySettings::default(),
            10.0,
            true,
            &library,
        );
        let mut visible = Vec::new();
        for (index, seen) in self.sources.iter().enumerate() {
            let source = match index.checked_sub(ANCHORS) {
                None => Source::Direct { anchor: index },
                Some(slot) => Source::Virtual { anchor: slot % ANCHORS, slot },
            };
            memory.tell(source, &seen.sinr);
            let [xx, yx, yy] = seen.covariance_m2;
            let covariance_m2 = Matrix2::new(xx, yx, yx, yy);
            visible.push(Visible {
                source,
                position_m: seen.position_m,
                height_m: 0.0,
                covariance_m2,
                availability: 1.0,
            });
        }
        let [x, y, u, v, xx, yy, uu, vv, elapsed_s, acceleration_density_m2_s3, ..] = OUTLOOK;
        let [.., variance_inflation, range_floor_m, roll_off, threshold] = OUTLOOK;
        let outlook = PlanningState {
            position_m: [x, y],
            velocity_m_s: [u, v],
            covariance: Matrix4::from_diagonal(&[xx, yy, uu, vv].into()),
            elapsed_s,
            motion: Motion {
                acceleration_density_m2_s3,
                velocity_decay_s: f32::INFINITY,
                ..Config::default().motion
            },
            variance_inflation,
            range_floor_m,
            range_floor_pulses: 0.0,
            radio: Radio {
                pulse_shape: PulseShape::RootRaisedCosine { roll_off },
                ..Config::default().radio
            },
            threshold,
        };
        let planned = std::array::from_fn(|action| action % 2 == 0);
        let horizon = Horizon { steps, discount: 0.5, reward: Reward::InformationGain };
        let scene = Planner::new(horizon, &outlook, &memory, &library);
        let given = [PositionInformation::default(); LONGEST_HORIZON];
        let rewards = scene.plan(&planned, visible.into_iter(), &given);
        let mut hash = TraceHash::default();
        rewards.iter().for_each(|reward| hash.float(*reward));
        hash.value()
    }
}

impl Default for Problem {
    fn default() -> Self {
        Self::new()
    }
}
