//! Hopping: how both ends of a link get to the next action together.
//!
//! The end that decides writes into every frame which action the next cycle uses, so a choice made after cycle n is
//! announced in cycle n + 1 and used from cycle n + 2 on. A lost frame leaves it open whether the other end has read the
//! announcement. Each end then stays where it is, and after three lost frames in a row goes to the rendezvous action,
//! where they meet again.
//!
//! Where one tag chooses for several anchors, one of them may be gone while the others answer. The tag then calls all of
//! them to the rendezvous, for a few cycles ([`LinkStatus`]); an anchor that is out of reach is called again only now and then.

use crate::snapshot::stored;

/// Guard: against ends that wait for each other: frames lost in a row after which an end goes to the rendezvous. The same at both
/// ends, so no setting of one.
pub const LOST_FRAMES: u32 = 3;
/// Guard: against an anchor that is left behind: cycles that the others wait at the rendezvous for one that is gone, the way there counted in.
pub const CALL: u32 = 5;
/// Guard: against calling without end one that is out of reach: cycles from one call to the next.
pub const CALL_AGAIN: u32 = 64;

/// One end of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hop {
    present: usize,
    announced: usize,
    rendezvous: usize,
    lost: u32,
}

impl Hop {
    /// An end that starts with the action `first` and goes to `rendezvous` when it hears nothing any more.
    pub fn new(first: usize, rendezvous: usize) -> Self {
        Self { present: first, announced: first, rendezvous, lost: 0 }
    }

    /// The action to use now.
    pub fn present(&self) -> usize {
        self.present
    }

    /// What the deciding end writes into the frame it sends now: the action of the next cycle.
    pub fn announced(&self) -> usize {
        self.announced
    }

    /// The action to meet at again.
    pub fn rendezvous(&self) -> usize {
        self.rendezvous
    }

    /// Frames lost in a row.
    pub fn lost(&self) -> u32 {
        self.lost
    }

    /// At the deciding end, the exchange came through: the other end knows the announcement, which holds from now on;
    /// `chosen` is announced next.
    pub fn decide(&mut self, chosen: usize) {
        self.follow(self.announced);
        self.announced = chosen;
    }

    /// At the other end, a frame came through that announces this action: it holds from now on.
    pub fn follow(&mut self, announced: usize) {
        self.present = announced;
        self.announced = announced;
        self.lost = 0;
    }

    /// At either end, nothing came through.
    pub fn miss(&mut self) {
        self.lost = self.lost.saturating_add(1);
        if self.lost >= LOST_FRAMES {
            self.present = self.rendezvous;
            self.announced = self.rendezvous;
        }
    }
}

/// Who answered the tag of late: the frames lost in a row from each of `ANCHORS` anchors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkStatus<const ANCHORS: usize> {
    lost: [u32; ANCHORS],
}

impl<const ANCHORS: usize> LinkStatus<ANCHORS> {
    /// Nothing is lost.
    pub const fn empty() -> Self {
        Self { lost: [0; ANCHORS] }
    }

    /// A cycle has passed: which of the anchors were heard.
    pub fn enter(&mut self, heard: impl Fn(usize) -> bool) {
        for (anchor, lost) in self.lost.iter_mut().enumerate() {
            *lost = if heard(anchor) { 0 } else { lost.saturating_add(1) };
        }
    }

    /// Whether one of the first `count` anchors is to be met at the rendezvous.
    pub fn calls(&self, count: usize) -> bool {
        let missing = |lost: &u32| *lost >= LOST_FRAMES && (lost - LOST_FRAMES) % CALL_AGAIN < CALL;
        self.lost.iter().take(count).any(missing)
    }

    /// The frames lost in a row, by anchor.
    pub fn lost(&self) -> &[u32; ANCHORS] {
        &self.lost
    }
}

stored!(blank Hop { present, announced, rendezvous, lost });
stored!(LinkStatus<const ANCHORS> { lost } told {});

#[cfg(test)]
mod tests {
    use super::*;
    use rand_core::{Rng, SeedableRng};

    #[test]
    fn a_choice_is_announced_before_it_is_used() {
        let (mut tag, mut anchor) = (Hop::new(5, 0), Hop::new(5, 0));
        for chosen in [7, 9, 9, 2, 4] {
            assert_eq!(tag.present(), anchor.present());
            let announced = tag.announced();
            anchor.follow(announced);
            tag.decide(chosen);
            assert_eq!(tag.present(), announced);
            assert_eq!(tag.announced(), chosen);
        }
    }

    /// Poll and answer are lost at random, and always on different actions. However they were parted, both ends meet again
    /// within seven cycles once the air is clear: at most three losses each, and the exchange.
    #[test]
    fn parted_ends_meet_again() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(3);
        for trial in 0..2000 {
            let (mut tag, mut anchor) = (Hop::new(1, 0), Hop::new(1, 0));
            let mut since_heard = 0;
            for cycle in 0..60 {
                let noisy = cycle < 40;
                let lost =
                    |rng: &mut rand_xoshiro::Xoshiro128PlusPlus| noisy && rng.next_u32().is_multiple_of(3);
                let together = tag.present() == anchor.present();
                let polled = together && !lost(&mut rng);
                let announced = tag.announced();
                if polled {
                    anchor.follow(announced)
                } else {
                    anchor.miss()
                }
                let answered = polled && !lost(&mut rng);
                let chosen = 1 + (rng.next_u32() % 9) as usize;
                if answered {
                    tag.decide(chosen)
                } else {
                    tag.miss()
                }
                since_heard = if answered || noisy { 0 } else { since_heard + 1 };
                assert!(since_heard < 7, "trial {trial}, cycle {cycle}: {tag:?} {anchor:?}");
            }
        }
    }

    /// One tag and three anchors, of which the last goes out of reach for good half-way: frames are lost at random, and every
    /// choice is another action. Whoever can be heard is, in nearly all cycles that lose nothing.
    #[test]
    fn a_tag_with_one_choice_for_all_keeps_its_anchors() {
        let mut rng = rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(5);
        for loss in [0_u32, 5, 10, 20] {
            let mut tag = Hop::new(1, 0);
            let mut anchors = [Hop::new(1, 0); 3];
            let mut roll = LinkStatus::<3>::empty();
            let mut heard_count = [0; 3];
            for cycle in 0..4000 {
                let mut lost = || rng.next_u32() % 100 < loss;
                let announced = tag.announced();
                let heard: std::vec::Vec<bool> = (0..3)
                    .map(|place| {
                        let anchor = &mut anchors[place];
                        let in_reach = place < 2 || cycle < 2000;
                        let polled = in_reach && tag.present() == anchor.present() && !lost();
                        if polled {
                            anchor.follow(announced)
                        } else {
                            anchor.miss()
                        }
                        polled && !lost()
                    })
                    .collect();
                roll.enter(|place| heard[place]);
                heard_count.iter_mut().zip(&heard).for_each(|(count, heard)| *count += usize::from(*heard));
                let chosen = if roll.calls(3) { 0 } else { 1 + (cycle / 7) % 9 };
                if heard.contains(&true) { tag.decide(chosen) } else { tag.miss() }
            }
            // An exchange is poll and answer.
            let both = (1.0 - f64::from(loss) / 100.0).powi(2);
            let [one, other, third] = heard_count.map(|count| count as f64 / 4000.0);
            assert!(one > 0.85 * both && other > 0.85 * both, "{loss} %: {one} {other}");
            assert!(third > 0.85 * both * 0.5, "{loss} %: {third}");
        }
    }
}
