//! Two-way ranging: from the time stamps of two radios to the distance between them.
//!
//! A radio stamps what it sends and receives with its own clock: 40 bits that count ticks of 1 / (128 x 499.2 MHz), 15.65 ps or 4.69 mm
//! of distance ([`TICK_M`]), and begin again after 17.2 s (DW1000 and DW3000 user manuals). One radio, here the initiator, sends a poll;
//! the other, the responder, answers; for a double-sided exchange the initiator answers again:
//!
//! ```text
//! initiator   poll sent --- round 1 --- response received --- reply 2 --- final sent
//! responder   poll received --- reply 1 --- response sent --- round 2 --- final received
//! ```
//!
//! With the time of flight t, an initiator's clock of the rate a and a responder's of the rate b (1: nominal), round 1 is a (2 t + r1)
//! and reply 1 is b r1, both r1 being the same time.
//!
//! - [`SingleSided`]: 2 t = round - reply / (1 + e), with e = b / a - 1 told. e stretches the reply: what is wrong in it by 1 ppm is
//!   0.15 m at a reply of 1 ms.
//! - [`DoubleSided`]: t = (round 1 x round 2 - reply 1 x reply 2) / (round 1 + round 2 + reply 1 + reply 2), which needs no e, and the
//!   replies need not be alike. With perfect stamps it is 2 a b / (a + b) t: the rates are left in the range alone, 20 ppm of it at the
//!   crystals' limit, 0.6 mm of 30 m.
//!
//! Differences and products are integers: a reply of 5 ms has 29 bits, of which f32 keeps steps of 0.15 m. Results are kept to 2^-16 ticks
//! (0.1 um) before they become f32. What is left is the stamps' own resolution of a tick: it puts a range of either kind off by less than
//! a tick, with a deviation of 0.25 to 0.3 ticks, 1.2 to 1.4 mm (and the radio's error in finding the first path, which is far more).
//!
//! # Antenna delays
//!
//! A radio stamps a signal inside itself. Until that leaves the antenna, and from the antenna to the stamp, time goes by: the transmit and
//! the receive delay. Each side's enter as their sum ([`AntennaDelays`]), in ticks of its clock: every interval has one of each. 1 tick
//! too few on either side makes a range 2.3 mm too long. Radios that are programmed with their delays have corrected the stamps: 0 then.

use crate::real::{SPEED_OF_LIGHT_M_S, abs};
use core::fmt;

/// Mathematics: ticks per second of a time stamp: 128 x 499.2 MHz.
pub const TICKS_PER_S: f32 = 128.0 * 499.2e6;
/// Mathematics: what light goes in a tick, metres: 4.69 mm.
pub const TICK_M: f32 = SPEED_OF_LIGHT_M_S / TICKS_PER_S;
/// Mathematics: bits of a time stamp.
pub const TIMESTAMP_BITS: u32 = 40;
/// Guard: against offsets in another unit (ppm, say): largest offset between two clocks. Crystals of UWB radios keep to 20e-6 each.
pub const MOST_OFFSET: f32 = 1e-4;
/// Guard: against ranges that no tracker takes: the longest, metres.
pub const LONGEST_M: f32 = 1e4;
/// Mathematics: bits behind the point of a clock offset.
const OFFSET_BITS: u32 = 40;
/// Mathematics: bits behind the point of a time of flight in ticks.
const FLIGHT_BITS: u32 = 16;
/// Mathematics: 2^`OFFSET_BITS`, exact in f32.
const OFFSET_SCALE: f32 = (1_u64 << OFFSET_BITS) as f32;
/// Mathematics: 2^-`FLIGHT_BITS`, exact in f32.
const FLIGHT_TICKS: f32 = 1.0 / (1_u32 << FLIGHT_BITS) as f32;

/// A time stamp of one radio's clock: 40 bits of ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Timestamp(u64);

impl Timestamp {
    /// Of a number of ticks, of which the lowest 40 bits count.
    pub const fn new(ticks: u64) -> Self {
        Self(ticks & ((1 << TIMESTAMP_BITS) - 1))
    }

    /// As the register has it: five bytes, the lowest first.
    pub const fn from_le_bytes(bytes: [u8; 5]) -> Self {
        let [a, b, c, d, e] = bytes;
        Self(u64::from_le_bytes([a, b, c, d, e, 0, 0, 0]))
    }

    /// Ticks, below 2^40.
    pub const fn ticks(self) -> u64 {
        self.0
    }

    /// Ticks from an earlier stamp of the same clock to this one, across the beginning of the count as well; less than 2^40. What is
    /// longer than 17.2 s cannot be told from what is shorter.
    pub const fn since(self, earlier: Self) -> u64 {
        Self::new(self.0.wrapping_sub(earlier.0)).0
    }

    /// The same where it is known to be less than half the count, 8.6 s.
    fn soon_after(self, earlier: Self) -> Result<i128, TwoWayError> {
        let ticks = self.since(earlier);
        if ticks >> (TIMESTAMP_BITS - 1) == 0 { Ok(i128::from(ticks)) } else { Err(TwoWayError::Order) }
    }
}

/// Antenna delays, each of transmission and reception together, ticks of the radio's own clock; 0 where the stamps are already corrected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AntennaDelays {
    /// Of the initiator.
    pub initiator_ticks: u32,
    /// Of the responder.
    pub responder_ticks: u32,
}

/// Why time stamps are no range.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum TwoWayError {
    /// Two stamps of a clock are in the wrong order, or 8.6 s or more apart.
    Order,
    /// The clock offset is NaN or beyond 1e-4.
    ClockOffset {
        /// The offset given.
        offset: f32,
    },
    /// A round takes no longer than the antenna delay in it.
    AntennaDelay,
    /// The range is not positive, or beyond 10 km: stamps of two exchanges, wrong antenna delays, or two radios as near as their noise.
    Range {
        /// The range, metres.
        range_m: f32,
    },
}

impl fmt::Display for TwoWayError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Order => {
                write!(f, "two time stamps of one clock are in the wrong order, or 8.6 s or more apart")
            }
            Self::ClockOffset { offset } => {
                write!(f, "the clock offset is {offset}, at most 1e-4 either way allowed")
            }
            Self::AntennaDelay => write!(f, "a round takes no longer than the antenna delay in it"),
            Self::Range { range_m } => write!(f, "the time stamps make a range of {range_m} m"),
        }
    }
}

impl core::error::Error for TwoWayError {}

/// A poll and its response.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SingleSided {
    /// When the initiator sent the poll, by its clock.
    pub poll_sent: Timestamp,
    /// When the responder received it, by its own.
    pub poll_received: Timestamp,
    /// When the responder sent the response.
    pub response_sent: Timestamp,
    /// When the initiator received it.
    pub response_received: Timestamp,
    /// Rate of the responder's clock over that of the initiator's, minus 1 (at most 1e-4 either way): positive where the responder's
    /// runs faster. 1e-6 is 1 ppm.
    pub responder_clock_offset: f32,
}

impl SingleSided {
    /// Distance, metres.
    ///
    /// # Errors
    /// The first of order, offset, antenna delays and range that is wrong.
    pub fn range_m(&self, delays: AntennaDelays) -> Result<f32, TwoWayError> {
        let round = self.response_received.soon_after(self.poll_sent)?;
        let reply = self.response_sent.soon_after(self.poll_received)?;
        let offset = self.responder_clock_offset;
        // Written so that NaN fails.
        if !(abs(offset) <= MOST_OFFSET) {
            return Err(TwoWayError::ClockOffset { offset });
        }
        let (round, reply) = between_antennas(round, reply, delays.initiator_ticks, delays.responder_ticks)?;
        // Both times 1 + e, which leaves one division: (round (1 + e) - reply) / (2 (1 + e)).
        let rate = i128::from((offset * OFFSET_SCALE) as i64) + (1 << OFFSET_BITS);
        range_of(round * rate - (reply << OFFSET_BITS), rate << 1)
    }
}

/// A poll, its response, and the response to that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DoubleSided {
    /// When the initiator sent the poll, by its clock.
    pub poll_sent: Timestamp,
    /// When the responder received it, by its own.
    pub poll_received: Timestamp,
    /// When the responder sent the response.
    pub response_sent: Timestamp,
    /// When the initiator received it.
    pub response_received: Timestamp,
    /// When the initiator sent the final.
    pub final_sent: Timestamp,
    /// When the responder received it.
    pub final_received: Timestamp,
}

impl DoubleSided {
    /// Distance, metres.
    ///
    /// # Errors
    /// The first of order, antenna delays and range that is wrong.
    pub fn range_m(&self, delays: AntennaDelays) -> Result<f32, TwoWayError> {
        let AntennaDelays { initiator_ticks: own, responder_ticks: theirs } = delays;
        let round_1 = self.response_received.soon_after(self.poll_sent)?;
        let reply_1 = self.response_sent.soon_after(self.poll_received)?;
        let round_2 = self.final_received.soon_after(self.response_sent)?;
        let reply_2 = self.final_sent.soon_after(self.response_received)?;
        let (round_1, reply_1) = between_antennas(round_1, reply_1, own, theirs)?;
        let (round_2, reply_2) = between_antennas(round_2, reply_2, theirs, own)?;
        range_of(round_1 * round_2 - reply_1 * reply_2, round_1 + round_2 + reply_1 + reply_2)
    }
}

/// A round and the reply in it as they are at the antennas: a round has begun later and ended sooner than its stamps say, by the delays
/// of its side; a reply the other way round.
fn between_antennas(round: i128, reply: i128, own: u32, theirs: u32) -> Result<(i128, i128), TwoWayError> {
    let round = round - i128::from(own);
    if round > 0 { Ok((round, reply + i128::from(theirs))) } else { Err(TwoWayError::AntennaDelay) }
}

/// The range of a time of flight of `over / under` ticks, `under` positive. Neither has more than 83 bits: there is room for
/// those behind the point.
// Once: where the processor has no division so wide, its code is long.
#[inline(never)]
fn range_of(over: i128, under: i128) -> Result<f32, TwoWayError> {
    let flight = (over << FLIGHT_BITS).checked_div(under).unwrap_or(0);
    // Less than 2^64 by far where it is a range at all.
    let flight = i64::try_from(flight).unwrap_or(if flight < 0 { i64::MIN } else { i64::MAX });
    let range_m = flight as f32 * (FLIGHT_TICKS * TICK_M);
    if range_m > 0.0 && range_m <= LONGEST_M { Ok(range_m) } else { Err(TwoWayError::Range { range_m }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICKS_PER_S_EXACT: f64 = 63.897_6e9;
    const TICK_M_EXACT: f64 = 299_792_458.0 / TICKS_PER_S_EXACT;
    const NO_DELAYS: AntennaDelays = AntennaDelays { initiator_ticks: 0, responder_ticks: 0 };

    /// A radio: when its count began, its rate, and its delays.
    #[derive(Clone, Copy)]
    struct Clock {
        /// 2^-20 ticks at time zero.
        began: i128,
        /// Offset of its rate, 1e-9.
        ppb: i128,
        sending: u32,
        receiving: u32,
    }

    /// Times are integers of 2^-20 nominal ticks, so that the clocks are exact but for the stamps' resolution.
    const FINE: i128 = 1 << 20;

    impl Clock {
        /// So many of its ticks after a time.
        fn stamp(&self, time: i128, ticks: i128) -> Timestamp {
            let fine = self.began + time + (time * self.ppb).div_euclid(1_000_000_000);
            Timestamp::new((fine.div_euclid(FINE) + ticks).rem_euclid(1 << 40) as u64)
        }

        fn sends(&self, at_antenna: i128) -> Timestamp {
            self.stamp(at_antenna, -i128::from(self.sending))
        }

        fn receives(&self, at_antenna: i128) -> Timestamp {
            self.stamp(at_antenna, i128::from(self.receiving))
        }

        fn delay_ticks(&self) -> u32 {
            self.sending + self.receiving
        }
    }

    fn fine(seconds: f64) -> i128 {
        (seconds * TICKS_PER_S_EXACT * FINE as f64).round() as i128
    }

    /// Exchange that begins at a time with the two replies given, seconds.
    fn exchange(own: &Clock, peer: &Clock, begin_s: f64, range_m: f64, replies_s: [f64; 2]) -> DoubleSided {
        let flight = fine(range_m / 299_792_458.0);
        let poll = fine(begin_s);
        let response = poll + flight + fine(replies_s[0]);
        let last = response + flight + fine(replies_s[1]);
        DoubleSided {
            poll_sent: own.sends(poll),
            poll_received: peer.receives(poll + flight),
            response_sent: peer.sends(response),
            response_received: own.receives(response + flight),
            final_sent: own.sends(last),
            final_received: peer.receives(last + flight),
        }
    }

    fn single(exchange: &DoubleSided, responder_clock_offset: f32) -> SingleSided {
        let DoubleSided { poll_sent, poll_received, response_sent, response_received, .. } = *exchange;
        SingleSided { poll_sent, poll_received, response_sent, response_received, responder_clock_offset }
    }

    fn clock(began: i128, ppm: i128) -> Clock {
        Clock { began: began * FINE, ppb: 1000 * ppm, sending: 0, receiving: 0 }
    }

    fn delays(own: &Clock, peer: &Clock) -> AntennaDelays {
        AntennaDelays { initiator_ticks: own.delay_ticks(), responder_ticks: peer.delay_ticks() }
    }

    /// Uniform in 0 to 1.
    fn uniform(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    #[test]
    fn stamps_have_forty_bits_and_count_on_from_zero() {
        assert_eq!(Timestamp::from_le_bytes([0x01, 0x02, 0x03, 0x04, 0xff]).ticks(), 0xff_0403_0201);
        assert_eq!(Timestamp::new(u64::MAX).ticks(), (1 << 40) - 1);
        let late = Timestamp::new((1 << 40) - 3);
        assert_eq!(Timestamp::new(4).since(late), 7);
        assert_eq!(late.since(Timestamp::new(4)), (1 << 40) - 7);
        assert_eq!(late.since(late), 0);
        assert!((f64::from(TICK_M) - 0.004_691_763_9).abs() < 1e-9);
    }

    /// By hand: 1000 ticks of flight are 4.691764 m.
    #[test]
    fn a_range_known_by_hand() {
        let stamp = Timestamp::new;
        let exchange = DoubleSided {
            poll_sent: stamp((1 << 40) - 500),
            poll_received: stamp(77_000),
            response_sent: stamp(77_000 + 300_000),
            response_received: stamp(302_000 - 500),
            final_sent: stamp(302_000 - 500 + 450_000),
            final_received: stamp(77_000 + 300_000 + 452_000),
        };
        let range_m = exchange.range_m(NO_DELAYS).unwrap();
        assert!((f64::from(range_m) - 4.691_763_9).abs() < 1e-6, "{range_m}");
        let range_m = single(&exchange, 0.0).range_m(NO_DELAYS).unwrap();
        assert!((f64::from(range_m) - 4.691_763_9).abs() < 1e-6, "{range_m}");
        // Delays of 100 and 60 ticks, uncorrected: 80 ticks less of flight.
        let delays = AntennaDelays { initiator_ticks: 100, responder_ticks: 60 };
        let shorter_m = single(&exchange, 0.0).range_m(delays).unwrap();
        assert!((f64::from(shorter_m) - 920.0 * TICK_M_EXACT).abs() < 1e-6, "{shorter_m}");
        let shorter_m = exchange.range_m(delays).unwrap();
        assert!((f64::from(shorter_m) - 920.0 * TICK_M_EXACT).abs() < 1e-6, "{shorter_m}");
    }

    /// Clocks 20 ppm off either way, replies of 5 ms and unlike ones, across the beginning of either count. The stamps' resolution is
    /// averaged out over exchanges that begin anywhere within a tick; one range alone is off by less than a tick for it.
    #[test]
    fn clock_offsets_leave_less_than_a_millimetre() {
        let mut random = 1;
        let (mut worst_m, mut worst_single_m, mut worst_one_m) = (0.0_f64, 0.0_f64, 0.0_f64);
        let (mut squares_m2, mut exchanges) = (0.0, 0_u32);
        for (own_ppm, peer_ppm) in [(0, 0), (20, 20), (20, -20), (-20, 20), (-20, -20), (3, -7)] {
            for (range_m, replies_s) in
                [(0.3, [5e-3, 5e-3]), (7.31, [5e-3, 5e-3]), (29.6, [5e-3, 5e-3]), (12.0, [5e-3, 0.8e-3])]
            {
                let own =
                    Clock { sending: 16_436, receiving: 16_440, ..clock((1 << 40) - 10_000_000, own_ppm) };
                let peer =
                    Clock { sending: 16_300, receiving: 16_500, ..clock((1 << 40) - 100_000_000, peer_ppm) };
                let own_rate = 1.0 + 1e-6 * own_ppm as f64;
                let offset = ((1.0 + 1e-6 * peer_ppm as f64) / own_rate - 1.0) as f32;
                let (mut sum_m, mut sum_single_m) = (0.0, 0.0);
                let runs = 4000;
                for _ in 0..runs {
                    let begin_s = 1e-3 * uniform(&mut random);
                    let scattered_s = replies_s.map(|reply_s| reply_s + 1e-7 * uniform(&mut random));
                    let exchange = exchange(&own, &peer, begin_s, range_m, scattered_s);
                    let double_m = f64::from(exchange.range_m(delays(&own, &peer)).unwrap());
                    let single_m = f64::from(single(&exchange, offset).range_m(delays(&own, &peer)).unwrap());
                    worst_one_m = worst_one_m.max((double_m - range_m).abs()).max((single_m - range_m).abs());
                    squares_m2 += (double_m - range_m).powi(2);
                    exchanges += 1;
                    sum_m += double_m - range_m;
                    sum_single_m += single_m - range_m;
                }
                worst_m = worst_m.max((sum_m / f64::from(runs)).abs());
                worst_single_m = worst_single_m.max((sum_single_m / f64::from(runs)).abs());
            }
        }
        let deviation_m = (squares_m2 / f64::from(exchanges)).sqrt();
        std::println!(
            "mean error at worst: double-sided {:.3} mm, single-sided {:.3} mm; one exchange: double-sided rms {:.2} mm, \
             either at worst {:.2} mm",
            1e3 * worst_m,
            1e3 * worst_single_m,
            1e3 * deviation_m,
            1e3 * worst_one_m
        );
        assert!(worst_m < 1e-3 && worst_single_m < 1e-3, "{worst_m} {worst_single_m}");
        assert!(worst_one_m < TICK_M_EXACT + 1e-3, "{worst_one_m}");
        assert!((deviation_m / TICK_M_EXACT - 0.25).abs() < 0.05, "{deviation_m}");
    }

    /// Against the formulas in f64 over the same stamps, whose rounding of products of 5 ms is a thousandth of a tick.
    #[test]
    fn the_arithmetic_is_that_of_the_formulas() {
        let (own, peer) = (clock((1 << 40) - 1_000, 20), clock(5, -20));
        let mut random = 7;
        for _ in 0..2000 {
            let range_m = 0.5 + 60.0 * uniform(&mut random);
            let replies_s = [0, 1].map(|_| 2e-4 + 8e-3 * uniform(&mut random));
            let exchange = exchange(&own, &peer, 3.0 * uniform(&mut random), range_m, replies_s);
            let between = |from: Timestamp, to: Timestamp| {
                (to.ticks() as f64 - from.ticks() as f64).rem_euclid(2.0_f64.powi(40))
            };
            let round_1 = between(exchange.poll_sent, exchange.response_received);
            let reply_1 = between(exchange.poll_received, exchange.response_sent);
            let round_2 = between(exchange.response_sent, exchange.final_received);
            let reply_2 = between(exchange.response_received, exchange.final_sent);
            // The difference of the products without their leading digits.
            let (a, b) = (round_1 - reply_1, round_2 - reply_2);
            let flight = (a * reply_2 + b * reply_1 + a * b) / (round_1 + round_2 + reply_1 + reply_2);
            let double_m = f64::from(exchange.range_m(NO_DELAYS).unwrap());
            assert!((double_m - flight * TICK_M_EXACT).abs() < 1e-5, "{double_m} {flight}");
            let offset = -40e-6_f32;
            let flight = 0.5 * (round_1 - reply_1 / (1.0 + f64::from(offset)));
            let single_m = f64::from(single(&exchange, offset).range_m(NO_DELAYS).unwrap());
            assert!((single_m - flight * TICK_M_EXACT).abs() < 1e-5, "{single_m} {flight}");
        }
    }

    /// What the offset is for: a reply of 5 ms at 40 ppm is 30 m of range.
    #[test]
    fn a_single_sided_range_needs_the_offset_and_its_sign() {
        let (own, peer) = (clock(0, -20), clock(0, 20));
        let exchange = exchange(&own, &peer, 0.01, 40.0, [5e-3, 5e-3]);
        let error_m = |offset| f64::from(single(&exchange, offset).range_m(NO_DELAYS).unwrap()) - 40.0;
        assert!((error_m(0.0) + 0.5 * 5e-3 * 40e-6 * 299_792_458.0).abs() < 0.02);
        assert!(error_m(40e-6).abs() < 0.02);
        assert!(
            matches!(single(&exchange, -40e-6).range_m(NO_DELAYS), Err(TwoWayError::Range { range_m }) if range_m < 0.0)
        );
    }

    #[test]
    fn what_is_no_exchange_is_refused() {
        let (own, peer) = (clock(0, 0), clock(0, 0));
        let good = exchange(&own, &peer, 0.01, 3.0, [5e-3, 5e-3]);
        for offset in [f32::NAN, 20.0, -1.1e-4] {
            let refused = single(&good, offset).range_m(NO_DELAYS);
            assert!(matches!(refused, Err(TwoWayError::ClockOffset { .. })), "{refused:?}");
        }
        let swapped =
            DoubleSided { poll_sent: good.response_received, response_received: good.poll_sent, ..good };
        assert_eq!(swapped.range_m(NO_DELAYS), Err(TwoWayError::Order));
        let too_much = AntennaDelays { initiator_ticks: u32::MAX, responder_ticks: 0 };
        assert_eq!(good.range_m(too_much), Err(TwoWayError::AntennaDelay));
        assert_eq!(single(&good, 0.0).range_m(too_much), Err(TwoWayError::AntennaDelay));
        let too_near = AntennaDelays { initiator_ticks: 0, responder_ticks: 1400 };
        assert!(matches!(good.range_m(too_near), Err(TwoWayError::Range { range_m }) if range_m < 0.0));
        // Nothing at all, and the longest intervals with the largest delays.
        let zero = Timestamp::new(0);
        let nothing = SingleSided {
            poll_sent: zero,
            poll_received: zero,
            response_sent: zero,
            response_received: zero,
            responder_clock_offset: 0.0,
        };
        assert_eq!(nothing.range_m(NO_DELAYS), Err(TwoWayError::AntennaDelay));
        let half = Timestamp::new((1 << 39) - 1);
        let most = AntennaDelays { initiator_ticks: u32::MAX, responder_ticks: u32::MAX };
        let long = SingleSided { response_received: half, responder_clock_offset: 1e-4, ..nothing };
        assert!(matches!(long.range_m(most), Err(TwoWayError::Range { .. })));
        let long = DoubleSided {
            poll_sent: zero,
            poll_received: zero,
            response_sent: zero,
            response_received: half,
            final_sent: half,
            final_received: half,
        };
        assert!(matches!(long.range_m(most), Err(TwoWayError::Range { .. })));
    }
}
