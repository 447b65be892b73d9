//! A cycle over a radio.

use super::{Phase, Tracker};
use crate::error::Error;
use crate::model::transceiver::{Moment, Transceiver, Tuning};
use crate::report::CycleReport;
use core::fmt;
use core::task::{Poll, ready};

/// Why a cycle over a radio stopped. It goes on with the next call.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CycleError<E> {
    /// The radio failed.
    Radio(E),
    /// The tracker refused what the radio delivered.
    Tracker(Error),
}

impl<E: fmt::Display> fmt::Display for CycleError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Radio(error) => write!(f, "the radio: {error}"),
            Self::Tracker(error) => write!(f, "the tracker: {error}"),
        }
    }
}

impl<E: core::error::Error + 'static> core::error::Error for CycleError<E> {
    fn source(&self) -> Option<&(dyn core::error::Error + 'static)> {
        match self {
            Self::Radio(error) => Some(error),
            Self::Tracker(error) => Some(error),
        }
    }
}

impl<
    const ANCHORS: usize,
    const SURFACES: usize,
    const SOURCES: usize,
    const SEGMENTS: usize,
    const PATHS: usize,
    const ACTIONS: usize,
    const COMPONENTS: usize,
    const POINTS: usize,
    const CANDIDATES: usize,
    const FRAMES: usize,
> Tracker<ANCHORS, SURFACES, SOURCES, SEGMENTS, PATHS, ACTIONS, COMPONENTS, POINTS, CANDIDATES, FRAMES>
{
    /// What the exchanges with an anchor are to use in the next cycle; `None` for an anchor that there is not.
    pub fn tuning(&self, anchor: usize) -> Option<Tuning> {
        let controller = self.controller_of(anchor)?;
        let index = controller.action_index();
        Some(Tuning { index, action: *self.library.get(index)?, announced: controller.announced() })
    }

    /// Runs a cycle over a radio: tunes it for each anchor, begins, receives each observation as it comes, and finishes when there is
    /// nothing more to come. The action chosen is what the radio is tuned to ahead of the next cycle. The same bits as
    /// [`Self::begin`], [`Self::receive`] and [`Self::finish`]. A cycle is begun from the radio's `begin` to the report: each call goes
    /// on where the last one stopped, and pending means that the radio has nothing yet.
    ///
    /// # Errors
    /// Each stops at what it is about, costs nothing else, and leaves the tracker as it was: call again, but for [`Error::NotStarted`] and
    /// [`Error::ToldChanged`], of a tracker that is to be started. The moment of a cycle that could not begin is lost. An observation that is
    /// refused is left out; a radio that failed is asked again. Where it stays broken, [`Self::finish`] ends the cycle by what came
    /// before.
    pub fn poll_cycle<R: Transceiver>(
        &mut self,
        radio: &mut R,
    ) -> Poll<Result<CycleReport, CycleError<R::Error>>> {
        if self.phase != Phase::Begun {
            self.check_ready().map_err(CycleError::Tracker)?;
            for anchor in 0..self.anchors.len() {
                if let Some(tuning) = self.tuning(anchor) {
                    radio.tune(anchor, &tuning).map_err(CycleError::Radio)?;
                }
            }
            let Moment { elapsed_s, tag_height } = ready!(radio.begin()).map_err(CycleError::Radio)?;
            self.begin(elapsed_s, tag_height).map_err(CycleError::Tracker)?;
        }
        while let Some(observation) = ready!(radio.receive()).map_err(CycleError::Radio)? {
            self.receive(&observation).map_err(CycleError::Tracker)?;
        }
        Poll::Ready(self.finish().map_err(CycleError::Tracker))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::model::anchor::Anchor;
    use crate::model::observation::{Observation, Range, RangeScan};
    use crate::model::plan::Map;
    use crate::radio::library::LIBRARY_DW1000;
    use std::vec;
    use std::vec::Vec;

    type Small = Tracker<3, 1, 1, 1, 2, 6, 4, 0, 0>;
    const PLACES_M: [[f32; 2]; 3] = [[0.0, 0.0], [10.0, 0.0], [5.0, 8.0]];

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Broken(u8);

    impl fmt::Display for Broken {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "broken {}", self.0)
        }
    }

    impl core::error::Error for Broken {}

    /// What a radio does next, in place of what it would.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Next {
        Tune(u8),
        Begin(u8),
        BeginLater,
        BadTime,
        Receive(u8),
        ReceiveLater,
        BadRange,
    }

    /// Ranges of three anchors to a tag that stands still; `script` says at which call what happens instead, once each.
    struct Radio {
        script: Vec<(u32, Next)>,
        cycle: u32,
        next_anchor: usize,
        ranges: [Range; 1],
        tuned: Vec<(usize, Tuning)>,
    }

    impl Radio {
        fn new(script: &[(u32, Next)]) -> Self {
            let ranges = [Range { range_m: 0.0, variance_m2: 0.0 }];
            Self { script: script.to_vec(), cycle: 0, next_anchor: 0, ranges, tuned: vec![] }
        }

        fn takes(&mut self, is: impl Fn(Next) -> bool) -> Option<Next> {
            let cycle = self.cycle;
            let at = self.script.iter().position(|(at, next)| *at == cycle && is(*next))?;
            Some(self.script.remove(at).1)
        }
    }

    impl Transceiver for Radio {
        type Error = Broken;

        fn tune(&mut self, anchor: usize, tuning: &Tuning) -> Result<(), Broken> {
            if let Some(Next::Tune(code)) = self.takes(|next| matches!(next, Next::Tune(_))) {
                return Err(Broken(code));
            }
            self.tuned.push((anchor, *tuning));
            Ok(())
        }

        fn begin(&mut self) -> Poll<Result<Moment, Broken>> {
            let here = |next| matches!(next, Next::Begin(_) | Next::BeginLater | Next::BadTime);
            match self.takes(here) {
                Some(Next::Begin(code)) => Poll::Ready(Err(Broken(code))),
                Some(Next::BeginLater) => Poll::Pending,
                Some(_) => Poll::Ready(Ok(Moment { elapsed_s: 0.0, tag_height: None })),
                None => {
                    self.next_anchor = 0;
                    self.cycle += 1;
                    Poll::Ready(Ok(Moment { elapsed_s: 0.1, tag_height: None }))
                }
            }
        }

        fn receive(&mut self) -> Poll<Result<Option<Observation<'_>>, Broken>> {
            let here = |next| matches!(next, Next::Receive(_) | Next::ReceiveLater | Next::BadRange);
            // In the middle of the cycle.
            let instead = if self.next_anchor == 1 { self.takes(here) } else { None };
            match instead {
                Some(Next::Receive(code)) => return Poll::Ready(Err(Broken(code))),
                Some(Next::ReceiveLater) => return Poll::Pending,
                _ => {}
            }
            if instead == Some(Next::BadRange) {
                self.ranges = [Range { range_m: -1.0, variance_m2: 4e-4 }];
                let scan = RangeScan { anchor: 1, ranges: &self.ranges };
                return Poll::Ready(Ok(Some(Observation::Ranges(scan))));
            }
            let anchor = self.next_anchor;
            let Some([x, y]) = PLACES_M.get(anchor) else { return Poll::Ready(Ok(None)) };
            self.next_anchor += 1;
            self.ranges = [Range { range_m: (x - 4.0).hypot(y - 3.0), variance_m2: 4e-4 }];
            Poll::Ready(Ok(Some(Observation::Ranges(RangeScan { anchor, ranges: &self.ranges }))))
        }
    }

    fn started() -> Small {
        let mut tracker = Small::new();
        let anchors = PLACES_M.map(|position_m| Anchor { position_m, height_m: 0.0 });
        let mut config = Config::default();
        config.controller.rendezvous = Some(0);
        tracker.start(&config, &anchors, &Map::default(), &LIBRARY_DW1000, 1).unwrap();
        tracker
    }

    /// What `cycles` cycles over a radio give: reports, hashes, and what stopped them, with the cycle that it was in.
    type Run = (Vec<(CycleReport, u64)>, Vec<(u32, Option<CycleError<Broken>>)>);

    fn run(tracker: &mut Small, radio: &mut Radio, cycles: usize) -> Run {
        let (mut reports, mut stops) = (vec![], vec![]);
        while reports.len() < cycles {
            match tracker.poll_cycle(radio) {
                Poll::Ready(Ok(report)) => reports.push((report, tracker.hash())),
                Poll::Ready(Err(error)) => stops.push((reports.len() as u32, Some(error))),
                Poll::Pending => stops.push((reports.len() as u32, None)),
            }
            assert!(stops.len() < 50, "it does not go on: {stops:?}");
        }
        (reports, stops)
    }

    #[test]
    fn a_cycle_over_a_radio_has_the_bits_of_one_by_hand() {
        let mut by_hand = started();
        let (reports, stops) = run(&mut started(), &mut Radio::new(&[]), 20);
        assert!(stops.is_empty());
        for (report, hash) in reports {
            by_hand.begin(0.1, None).unwrap();
            for (anchor, [x, y]) in PLACES_M.into_iter().enumerate() {
                let ranges = [Range { range_m: (x - 4.0_f32).hypot(y - 3.0), variance_m2: 4e-4 }];
                by_hand.receive(&Observation::Ranges(RangeScan { anchor, ranges: &ranges })).unwrap();
            }
            assert_eq!(by_hand.finish().unwrap(), report);
            assert_eq!(by_hand.hash(), hash);
        }
    }

    #[test]
    fn the_radio_is_tuned_for_every_anchor_to_what_was_chosen() {
        let (mut tracker, mut radio) = (started(), Radio::new(&[]));
        let (reports, _) = run(&mut tracker, &mut radio, 30);
        assert_eq!(radio.tuned.len(), 3 * 30);
        let mut chosen = (0, Some(0));
        for (tuned, (report, _)) in radio.tuned.chunks(3).zip(&reports) {
            for (anchor, (told, tuning)) in tuned.iter().enumerate() {
                assert_eq!(*told, anchor);
                assert_eq!((tuning.index, tuning.announced), chosen);
                assert_eq!(tuning.action, LIBRARY_DW1000[tuning.index]);
            }
            chosen = (report.next_action, report.announced_action);
        }
        assert!(reports.iter().any(|(report, _)| report.next_action != 0), "it never left its first action");
        assert!(tracker.tuning(3).is_none());
    }

    /// Each kind of failure, and waiting, in a cycle of its own: all are handed on, by whose they are, and all bits are those of a
    /// run without them.
    #[test]
    fn what_stops_a_cycle_costs_nothing_but_itself() {
        let refused = |error| Some(CycleError::Tracker(error));
        let failed = |code| Some(CycleError::Radio(Broken(code)));
        let stops = [
            (2, Next::Tune(2), failed(2)),
            (4, Next::Begin(4), failed(4)),
            (6, Next::BeginLater, None),
            (8, Next::BadTime, refused(Error::Time { elapsed_s: 0.0 })),
            (11, Next::Receive(10), failed(10)),
            (13, Next::ReceiveLater, None),
            (15, Next::BadRange, refused(Error::Range { anchor: 1, index: 0 })),
        ];
        let (expected, _) = run(&mut started(), &mut Radio::new(&[]), 20);
        // The radio counts from the cycle it begins next on, as which it counts the one begun.
        let script = stops.map(|(cycle, next, _)| (cycle, next));
        let (reports, seen) = run(&mut started(), &mut Radio::new(&script), 20);
        let cycles = [2, 4, 6, 8, 10, 12, 14];
        let told: Vec<_> = cycles.into_iter().zip(stops.map(|(_, _, error)| error)).collect();
        assert_eq!(seen, told);
        assert_eq!(reports, expected);
    }

    #[test]
    fn a_cycle_whose_radio_stays_broken_ends_by_what_came_before() {
        let (mut tracker, mut by_hand) = (started(), started());
        let mut radio = Radio::new(&[(1, Next::Receive(1)), (1, Next::Receive(2))]);
        assert_eq!(tracker.poll_cycle(&mut radio), Poll::Ready(Err(CycleError::Radio(Broken(1)))));
        assert_eq!(tracker.poll_cycle(&mut radio), Poll::Ready(Err(CycleError::Radio(Broken(2)))));
        assert_eq!(tracker.finish().unwrap().anchors_heard, 1);
        by_hand.begin(0.1, None).unwrap();
        let ranges = [Range { range_m: 5.0, variance_m2: 4e-4 }];
        by_hand.receive(&Observation::Ranges(RangeScan { anchor: 0, ranges: &ranges })).unwrap();
        by_hand.finish().unwrap();
        assert_eq!(tracker.hash(), by_hand.hash());
        // The next one begins anew.
        let (reports, stops) = run(&mut tracker, &mut radio, 1);
        assert!(stops.is_empty());
        assert_eq!(reports.first().unwrap().0.anchors_heard, 3);
    }

    #[test]
    fn a_tracker_that_was_not_started_says_so() {
        let error = Small::new().poll_cycle(&mut Radio::new(&[]));
        assert_eq!(error, Poll::Ready(Err(CycleError::Tracker(Error::NotStarted))));
        let error: CycleError<Broken> = CycleError::Radio(Broken(7));
        assert_eq!(std::format!("{error}"), "the radio: broken 7");
        assert!(core::error::Error::source(&error).is_some());
    }
}
