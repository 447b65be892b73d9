//! The reduced filter against the textbook: a 2n+1-point unscented filter over the whole state in f64, and the
//! covariance's definiteness over many cycles.

use cogmint::reference::{range, soft_update, state_filter as twin, surface};
use cogmint_core::model::image::Sequence;
use cogmint_core::model::motion::Motion;
use cogmint_core::model::soft_update::Moments;
use cogmint_core::model::source::{Sight, Source};
use cogmint_core::model::surface::Surface;
use cogmint_core::perceptor::association::outcome::Innovation;
use cogmint_core::perceptor::state_filter::StateFilter;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

struct Noise(Xoshiro128PlusPlus);

impl Noise {
    fn uniform(&mut self) -> f64 {
        (f64::from(self.0.next_u32()) + 0.5) / 4_294_967_296.0
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// The textbook filter: sigma points over all states, batch update with a diagonal measurement covariance.
struct Textbook {
    x: DVector<f64>,
    p: DMatrix<f64>,
}

impl Textbook {
    /// At constant velocity, driven by white acceleration of this density; the map walks by `walk` in the root of a second.
    fn predict(&mut self, dt: f64, density: f64, walk: f64) {
        let n = self.x.len();
        let mut f = DMatrix::identity(n, n);
        f[(0, 2)] = dt;
        f[(1, 3)] = dt;
        self.x = &f * &self.x;
        self.p = &f * &self.p * f.transpose();
        for axis in 0..2 {
            self.p[(axis, axis)] += density * dt.powi(3) / 3.0;
            self.p[(axis, axis + 2)] += density * dt.powi(2) / 2.0;
            self.p[(axis + 2, axis)] += density * dt.powi(2) / 2.0;
            self.p[(axis + 2, axis + 2)] += density * dt;
        }
        for i in 4..n {
            self.p[(i, i)] += walk * walk * dt;
        }
    }

    /// Sigma points at +-sqrt(n) standard deviations with weights 1 / 2n.
    fn update(&mut self, z: &DVector<f64>, r: f64, measure: impl Fn(&DVector<f64>) -> DVector<f64>) {
        let n = self.x.len();
        let root = self.p.clone().cholesky().expect("positive definite").l() * (n as f64).sqrt();
        let points: Vec<DVector<f64>> =
            (0..n).flat_map(|i| [&self.x + root.column(i), &self.x - root.column(i)]).collect();
        let images: Vec<DVector<f64>> = points.iter().map(&measure).collect();
        let weight = 1.0 / points.len() as f64;
        let mean = images.iter().sum::<DVector<f64>>() * weight;
        let mut pzz = DMatrix::identity(z.len(), z.len()) * r;
        let mut pxz = DMatrix::zeros(n, z.len());
        for (point, image) in points.iter().zip(&images) {
            pzz += (image - &mean) * (image - &mean).transpose() * weight;
            pxz += (point - &self.x) * (image - &mean).transpose() * weight;
        }
        let gain = &pxz * pzz.clone().try_inverse().expect("invertible");
        self.x += &gain * (z - mean);
        self.p -= &gain * pzz * gain.transpose();
        self.p = (&self.p + self.p.transpose()) * 0.5;
    }
}

const ANCHORS: [[f32; 2]; 2] = [[0.5, 7.0], [5.2, 3.2]];

/// What reflects a path where every virtual anchor is a private surface: the one in its slot.
fn sequence(source: Source) -> Option<Sequence> {
    match source {
        Source::Direct { .. } => None,
        Source::Virtual { slot, .. } => Some(Sequence::of(slot as u8)),
    }
}

/// Takes a virtual anchor in as a private surface.
fn insert<const A: usize, const V: usize>(
    filter: &mut StateFilter<A, V>,
    slot: usize,
    [x, y]: [f32; 2],
    std_m: f32,
) -> bool {
    filter.insert_independent(slot, Surface::Private, Vector2::new(x, y), [std_m; 2])
}

/// Applies one hard-associated range to the reduced filter.
fn innovation<const A: usize, const V: usize>(
    filter: &StateFilter<A, V>,
    source: Source,
    range_m: f32,
    variance_m2: f32,
) -> Innovation {
    let sight =
        Sight { anchor_m: ANCHORS[source.anchor()], height_m: 0.0, height_std_m: 0.0, lever_arm_m: [0.0; 2] };
    let regression = filter.regress(source, &sight, sequence(source).as_ref()).expect("an occupied source");
    let nu = range_m - regression.range_m;
    Innovation::hard(regression, nu, variance_m2)
}

#[test]
fn the_reduced_filter_agrees_with_the_textbook_filter_over_a_thousand_cycles() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(11));
    let motion = Motion {
        acceleration_density_m2_s3: 0.01,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-4,
    };
    let true_vas = [[-0.5_f64, 7.0], [11.5, 7.0], [0.5, -7.0], [6.8, 3.2], [5.2, -3.2], [5.2, 13.8]];
    let mut filter = StateFilter::<2, 8>::new(motion, 30.0, [3.02, 7.80], 0.1, 0.03, 0.0, 0.0);
    let n = 4 + 2 * true_vas.len();
    let mut textbook = Textbook { x: DVector::zeros(n), p: DMatrix::zeros(n, n) };
    for (i, deviation) in [0.1_f64, 0.1, 0.03, 0.03].iter().enumerate() {
        textbook.p[(i, i)] = deviation * deviation;
    }
    textbook.x[0] = f64::from(3.02_f32);
    textbook.x[1] = f64::from(7.80_f32);
    for (slot, [x, y]) in true_vas.iter().enumerate() {
        let guess = [(x + 0.05 * noise.normal()) as f32, (y + 0.05 * noise.normal()) as f32];
        assert!(insert(&mut filter, slot, guess, 0.05));
        for (axis, coordinate) in guess.iter().enumerate() {
            let i = 4 + 2 * slot + axis;
            textbook.x[i] = f64::from(*coordinate);
            textbook.p[(i, i)] = 0.0025;
        }
    }
    let mut worst: f64 = 0.0;
    let mut squared = 0.0;
    for cycle in 0..1000 {
        // A slow circle: 1 cm per cycle.
        let angle = 0.01 * f64::from(cycle) / 1.2;
        let truth = [1.8 + 1.2 * angle.cos(), 7.8 - 1.5 + 1.5 * (angle + 1.57).sin()];
        filter.predict(1.0);
        textbook.predict(1.0, 0.01, 1e-4);
        let deviation = 0.02;
        let sources: Vec<(Source, [f64; 2])> = (0..2)
            .map(|anchor| (Source::Direct { anchor }, ANCHORS[anchor].map(f64::from)))
            .chain(
                true_vas
                    .iter()
                    .enumerate()
                    .map(|(slot, a)| (Source::Virtual { anchor: usize::from(slot > 2), slot }, *a)),
            )
            .collect();
        let ranges: Vec<f32> = sources
            .iter()
            .map(|(_, [x, y])| ((truth[0] - x).hypot(truth[1] - y) + deviation * noise.normal()) as f32)
            .collect();
        let innovations: Vec<Innovation> = sources
            .iter()
            .zip(&ranges)
            .map(|((source, _), z)| innovation(&filter, *source, *z, (deviation * deviation) as f32))
            .collect();
        filter.update(innovations);
        let z = DVector::from_iterator(ranges.len(), ranges.iter().map(|z| f64::from(*z)));
        textbook.update(&z, deviation * deviation, |x| {
            DVector::from_iterator(
                sources.len(),
                sources.iter().map(|(source, anchor)| {
                    let [ax, ay] = match source {
                        Source::Direct { .. } => *anchor,
                        Source::Virtual { slot, .. } => [x[4 + 2 * slot], x[5 + 2 * slot]],
                    };
                    (x[0] - ax).hypot(x[1] - ay)
                }),
            )
        });
        let [x, y] = filter.position_m().map(f64::from);
        worst = worst.max((x - textbook.x[0]).hypot(y - textbook.x[1]));
        squared += (x - truth[0]).powi(2) + (y - truth[1]).powi(2);
    }
    let rmse = (squared / 1000.0_f64).sqrt();
    println!("largest distance to the textbook filter {:.3} mm, RMSE {:.1} mm", worst * 1e3, rmse * 1e3);
    assert!(worst < 5e-3, "{worst} m from the textbook filter");
    assert!(rmse < 0.03, "{rmse} m from the truth: the comparison must be on a working track");
}

/// The same ranges to virtual anchors known exactly, and to physical anchors in their places.
#[test]
fn a_virtual_anchor_known_exactly_is_a_physical_anchor_that_never_moves() {
    let motion = Motion {
        acceleration_density_m2_s3: 0.1,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-2,
    };
    let exact = [(0, [-0.5_f32, 7.0]), (3, [5.2, -3.2])];
    for bias_std_m in [0.0, 0.2] {
        let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(41));
        let mut ours = StateFilter::<2, 4>::new(motion, 30.0, [3.0, 7.0], 0.3, 0.1, 0.02, bias_std_m);
        // A virtual anchor of the usual kind, correlated with the tag.
        assert!(insert(&mut ours, 1, [11.5, 7.0], 0.2));
        let mut theirs = ours.clone();
        for (slot, place) in exact {
            assert!(insert(&mut ours, slot, place, 0.0));
        }
        for cycle in 0..2000 {
            // Now and then so long that the position's variance meets its limit.
            let elapsed_s = if cycle % 500 == 250 { 600.0 } else { 0.1 };
            ours.predict(elapsed_s);
            theirs.predict(elapsed_s);
            let deviation = if cycle % 2 == 0 { 1e-3 } else { 0.1 };
            let mut heard = Vec::new();
            for (anchor, anchor_m) in ANCHORS.into_iter().enumerate() {
                heard.push((Source::Direct { anchor }, Source::Direct { anchor }, anchor_m));
                let (slot, place) = exact[anchor];
                heard.push((Source::Virtual { anchor, slot }, Source::Direct { anchor }, place));
            }
            let usual = Source::Virtual { anchor: 0, slot: 1 };
            heard.push((usual, usual, [0.0, 0.0]));
            let angle = 0.01 * f64::from(cycle);
            let truth = [3.0 + angle.sin(), 6.0 + angle.cos()];
            let (mut to_ours, mut to_theirs) = (Vec::new(), Vec::new());
            for (own, other, place) in heard {
                let [x, y] = if own == usual { [11.4, 7.1] } else { place.map(f64::from) };
                let range_m = ((truth[0] - x).hypot(truth[1] - y) + deviation * noise.normal()) as f32;
                let weight = 0.5 + 0.5 * noise.uniform() as f32;
                let update = |filter: &StateFilter<2, 4>, source, anchor_m| {
                    let regression = filter
                        .regress(
                            source,
                            &Sight { anchor_m, height_m: 0.5, height_std_m: 0.2, lever_arm_m: [0.0; 2] },
                            sequence(source).as_ref(),
                        )
                        .unwrap();
                    let nu = range_m - regression.range_m;
                    let variance_m2 = (deviation * deviation) as f32;
                    let moments = Moments { weight, first_m: weight * nu, second_m2: weight * nu * nu };
                    Innovation { regression, moments, variance_m2, alike_m2: 0.0 }
                };
                to_ours.push(update(&ours, own, place));
                to_theirs.push(update(&theirs, other, place));
            }
            ours.update(to_ours);
            theirs.update(to_theirs);
            assert_eq!(ours.agent(), theirs.agent(), "bias {bias_std_m}, cycle {cycle}");
            assert_eq!(ours.surface(1), theirs.surface(1), "bias {bias_std_m}, cycle {cycle}");
            for anchor in 0..2 {
                assert_eq!(ours.bias_m(anchor), theirs.bias_m(anchor), "bias {bias_std_m}, cycle {cycle}");
            }
            let (all, without) = (covariance(&ours), covariance(&theirs));
            for (slot, [x, y]) in exact {
                let (_, mean, block) = ours.surface(slot).unwrap();
                assert_eq!((mean, block), (Vector2::new(x, y), Matrix2::zeros()), "cycle {cycle}");
            }
            assert_eq!(all, without, "cycle {cycle}: correlated with what is known exactly");
        }
        let spread = ours.agent_covariance().m11;
        assert!(spread < 0.1, "{spread} m^2: it was a track");
    }
}

/// Changes of the virtual anchors' covariance wait for each other in the core; the reference makes each at once.
#[test]
fn changes_that_wait_give_the_bits_of_one_after_the_other() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(5));
    let motion = Motion {
        acceleration_density_m2_s3: 0.3,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-3,
    };
    for bias_std_m in [0.0, 0.2] {
        let mut filter = StateFilter::<2, 24>::new(motion, 30.0, [3.0, 7.0], 2.0, 0.5, 0.1, bias_std_m);
        let prior = twin::Prior {
            reach_m: 30.0,
            position_m: [3.0, 7.0],
            position_std_m: 2.0,
            velocity_std_m_s: 0.5,
            bias_mean_m: 0.1,
            bias_std_m,
        };
        let mut reference = twin::StateFilter::<f32>::new(2, 24, motion, &prior);
        // Every fifth slot stays free.
        let slots: Vec<usize> = (0..24).filter(|slot| slot % 5 != 3).collect();
        for &slot in &slots {
            let place = [20.0 * noise.uniform() as f32 - 7.0, 20.0 * noise.uniform() as f32 - 5.0];
            assert!(insert(&mut filter, slot, place, 1.0));
            reference.insert_independent(slot, surface::Surface::Private, place, [1.0; 2]);
        }
        for cycle in 0..300 {
            filter.predict(0.1);
            reference.predict(0.1);
            // From none to more than fill several passes; the same virtual anchor may come twice.
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            for _ in 0..cycle % 12 {
                let anchor = usize::from(noise.uniform() < 0.5);
                let source = if noise.uniform() < 0.2 {
                    Source::Direct { anchor }
                } else {
                    Source::Virtual { anchor, slot: slots[(noise.uniform() * slots.len() as f64) as usize] }
                };
                let line = filter
                    .regress(
                        source,
                        &Sight {
                            anchor_m: ANCHORS[anchor],
                            height_m: 1.0,
                            height_std_m: 0.4,
                            lever_arm_m: [0.0; 2],
                        },
                        sequence(source).as_ref(),
                    )
                    .unwrap();
                let sight =
                    range::Sight { anchor_m: ANCHORS[anchor], height_m: [1.0, 0.4], lever_arm_m: [0.0; 2] };
                let reference_line = reference.regress(source, &sight, sequence(source).as_ref());
                let weight = noise.uniform() as f32;
                let first_m = weight * 0.1 * noise.normal() as f32;
                let second_m2 = first_m * first_m / weight + 0.01 * noise.uniform() as f32;
                let variance_m2 = 1e-4;
                let moments = Moments { weight, first_m, second_m2 };
                ours.push(Innovation { regression: line, moments, variance_m2, alike_m2: 0.0 });
                let moments = soft_update::Moments { weight, first_m, second_m2 };
                theirs.push(twin::Innovation {
                    regression: reference_line,
                    moments,
                    variance_m2,
                    alike_m2: 0.0,
                });
            }
            filter.update(ours);
            reference.update(&theirs);
            let mut numbers = Vec::new();
            filter.visit(|value| numbers.push(value));
            let mut numbers = numbers.into_iter();
            reference.visit(&mut |name, value| {
                let own = numbers.next().expect("as many numbers");
                assert!(
                    own.to_bits() == value.to_bits(),
                    "bias {bias_std_m}, cycle {cycle}, {name}: {own} {value}"
                );
            });
            assert_eq!(numbers.next(), None);
        }
    }
}

#[test]
fn the_order_of_measurements_within_a_cycle_does_not_matter() {
    let motion = Motion {
        acceleration_density_m2_s3: 0.01,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-4,
    };
    let mut forwards = StateFilter::<2, 4>::new(motion, 30.0, [3.0, 7.0], 0.3, 0.03, 0.0, 0.0);
    assert!(insert(&mut forwards, 0, [-0.5, 7.0], 0.2));
    let mut backwards = forwards.clone();
    forwards.predict(1.0);
    backwards.predict(1.0);
    let ranges = [
        (Source::Direct { anchor: 0 }, 2.6),
        (Source::Direct { anchor: 1 }, 4.4),
        (Source::Virtual { anchor: 0, slot: 0 }, 3.6),
    ];
    let innovations = ranges.map(|(source, z)| innovation(&forwards, source, z, 1e-3));
    forwards.update(innovations);
    backwards.update(innovations.into_iter().rev());
    for (a, b) in forwards.position_m().iter().zip(backwards.position_m()) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

/// The whole covariance: agent, biases, virtual anchors by slot.
fn covariance<const A: usize, const V: usize>(filter: &StateFilter<A, V>) -> DMatrix<f64> {
    let mut numbers = Vec::new();
    filter.visit(|v| numbers.push(f64::from(v)));
    let (biases, slots) = (4, 4 + A);
    let n = slots + 2 * V;
    let mut c = DMatrix::<f64>::zeros(n, n);
    // The means, and what each surface is: all private here.
    let mut numbers = numbers.into_iter().skip(n + V);
    let mut block = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| {
        for column in columns {
            for row in rows.clone() {
                let value = numbers.next().expect("as many numbers as entries");
                c[(row, column)] = value;
                c[(column, row)] = value;
            }
        }
    };
    // Order of `visit` after the means: C_xx, C_xb, C_bb by rows, then per virtual anchor C_xa, C_ba by biases, and C_aa
    // up to its own.
    block(0..4, 0..4);
    block(0..4, biases..slots);
    block(biases..slots, biases..slots);
    for k in 0..V {
        let own = slots + 2 * k..slots + 2 * k + 2;
        block(0..4, own.clone());
        block(own.clone(), biases..slots);
        for l in 0..=k {
            block(own.clone(), slots + 2 * l..slots + 2 * l + 2);
        }
    }
    assert!(numbers.next().is_none());
    c
}

/// Cholesky pivots of a covariance without its rows and columns of zeros; the least, relative to its diagonal.
fn least_pivot(covariance: &DMatrix<f64>) -> f64 {
    let used: Vec<usize> = (0..covariance.nrows()).filter(|&i| covariance[(i, i)] != 0.0).collect();
    let mut c = covariance.select_rows(&used).select_columns(&used);
    let n = used.len();
    let mut least = f64::INFINITY;
    for i in 0..n {
        let diagonal = c[(i, i)];
        for k in 0..i {
            let factor = c[(i, k)];
            let d = c[(k, k)];
            for j in i..n {
                let other = c[(j, k)];
                c[(j, i)] -= factor * other / d;
            }
        }
        least = least.min(c[(i, i)] / diagonal);
    }
    least
}

/// Cycles of the definiteness test: a quick share by default, COGMINT_PD_CYCLES for the full million.
fn definiteness_cycles() -> usize {
    std::env::var("COGMINT_PD_CYCLES").ok().and_then(|n| n.parse().ok()).unwrap_or(6_000)
}

#[test]
fn the_covariance_stays_positive_definite_at_full_size() {
    for deviation in [1e-3_f64, 1e-2, 1.0] {
        for prior in [0.03_f32, 10.0] {
            let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(3));
            let motion = Motion {
                acceleration_density_m2_s3: 0.01,
                velocity_decay_s: f32::INFINITY,
                virtual_anchor_walk_m_sqrt_s: 1e-4,
            };
            let mut filter = StateFilter::<2, 24>::new(motion, 30.0, [3.0, 7.0], prior, 0.03, 0.0, 0.0);
            let mut images = Vec::new();
            for slot in 0..24 {
                let image = [20.0 * noise.uniform() - 7.0, 20.0 * noise.uniform() - 5.0];
                let guess = image.map(|x| (x + f64::from(prior) * 0.3 * noise.normal()) as f32);
                assert!(insert(&mut filter, slot, guess, prior));
                images.push(image);
            }
            let mut least = f64::INFINITY;
            let cycles = definiteness_cycles();
            for cycle in 0..cycles {
                let angle = 0.003 * cycle as f64;
                let truth = [3.0 + angle.sin(), 6.0 + angle.cos()];
                filter.predict(0.1);
                let mut innovations = Vec::new();
                for (anchor, [x, y]) in ANCHORS.iter().enumerate() {
                    let range = (truth[0] - f64::from(*x)).hypot(truth[1] - f64::from(*y));
                    let z = (range + deviation * noise.normal()) as f32;
                    let r = (deviation * deviation) as f32;
                    innovations.push(innovation(&filter, Source::Direct { anchor }, z, r));
                }
                for (slot, [x, y]) in images.iter().enumerate() {
                    if noise.uniform() < 0.2 {
                        continue;
                    }
                    let z = ((truth[0] - x).hypot(truth[1] - y) + deviation * noise.normal()) as f32;
                    let source = Source::Virtual { anchor: slot % 2, slot };
                    innovations.push(innovation(&filter, source, z, (deviation * deviation) as f32));
                }
                filter.update(innovations);
                if cycle < 100 || cycle % 200 == 0 {
                    least = least.min(least_pivot(&covariance(&filter)));
                    assert!(
                        least > 0.0,
                        "deviation {deviation} m, prior {prior} m, cycle {cycle}: relative pivot {least:e}"
                    );
                }
            }
            println!(
                "deviation {deviation} m, prior {prior} m: least relative pivot {least:.1e} in {cycles} cycles"
            );
        }
    }
}

#[test]
fn range_biases_are_found_while_the_tag_moves() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(21));
    let anchors = [[0.0_f32, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]];
    let biases = [0.20_f64, -0.10, 0.30, 0.05];
    let motion = Motion {
        acceleration_density_m2_s3: 0.5,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-4,
    };
    let mut filter = StateFilter::<4, 1>::new(motion, 30.0, [3.0, 4.5], 0.3, 0.5, 0.0, 0.2);
    for cycle in 0..3000 {
        let angle = 0.05 * f64::from(cycle);
        let truth = [3.0 + 2.0 * angle.sin(), 3.0 + 1.5 * (0.7 * angle).cos()];
        filter.predict(0.1);
        let innovations: Vec<Innovation> = (0..4)
            .map(|anchor| {
                let [x, y] = anchors[anchor].map(f64::from);
                let range = (truth[0] - x).hypot(truth[1] - y) + biases[anchor] + 0.05 * noise.normal();
                let sight = Sight {
                    anchor_m: anchors[anchor],
                    height_m: 0.0,
                    height_std_m: 0.0,
                    lever_arm_m: [0.0; 2],
                };
                let regression = filter.regress(Source::Direct { anchor }, &sight, None).unwrap();
                let nu = range as f32 - regression.range_m;
                Innovation::hard(regression, nu, 0.0025)
            })
            .collect();
        filter.update(innovations);
    }
    for (anchor, bias) in biases.iter().enumerate() {
        let (mean, variance) = filter.bias_m(anchor).unwrap();
        let error = f64::from(mean) - bias;
        println!("anchor {anchor}: bias off by {error:.3} m, deviation {:.3} m", variance.sqrt());
        assert!(error.abs() < 0.03 && variance.sqrt() < 0.03, "anchor {anchor}: {error} m");
    }
}

/// A filter with correlations everywhere: two biases, and virtual anchors in three of its five slots.
fn correlated(noise: &mut Noise) -> StateFilter<2, 5> {
    let motion = Motion {
        acceleration_density_m2_s3: 0.1,
        velocity_decay_s: f32::INFINITY,
        virtual_anchor_walk_m_sqrt_s: 1e-4,
    };
    let mut filter = StateFilter::<2, 5>::new(motion, 30.0, [3.0, 7.0], 0.2, 0.3, 0.0, 0.1);
    let images = [(0, [-0.5, 7.0]), (2, [11.5, 7.0]), (4, [5.2, -3.2])];
    for (slot, image) in images {
        assert!(insert(&mut filter, slot, image, 0.2));
    }
    for cycle in 0..30 {
        let truth = [3.0 + 0.03 * f64::from(cycle), 7.0 - 0.02 * f64::from(cycle)];
        filter.predict(0.1);
        let sources = (0..2)
            .map(|anchor| (Source::Direct { anchor }, ANCHORS[anchor]))
            .chain(images.map(|(slot, image)| (Source::Virtual { anchor: slot / 3, slot }, image)));
        let innovations: Vec<Innovation> = sources
            .map(|(source, [x, y])| {
                let range = (truth[0] - f64::from(x)).hypot(truth[1] - f64::from(y));
                innovation(&filter, source, (range + 0.05 * noise.normal()) as f32, 0.0025)
            })
            .collect();
        filter.update(innovations);
    }
    filter
}

#[test]
fn what_is_inserted_relative_to_the_tag_moves_with_it_and_with_all_it_is_correlated_with() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(31));
    for slot in [1, 3] {
        for _ in 0..50 {
            let mut filter = correlated(&mut noise);
            let before = covariance(&filter);
            let mut uniform = || (4.0 * noise.uniform() - 2.0) as f32;
            let gain = Matrix2::new(uniform(), uniform(), uniform(), uniform());
            let root = Matrix2::new(uniform(), uniform(), uniform(), uniform()) * 0.1;
            let own = root * root.transpose();
            assert!(filter.insert_relative(slot, Vector2::new(1.0, 2.0), &gain, &own));
            let after = covariance(&filter);

            // C <- M C M' + N, where M copies every state and puts G p in the place of the new one.
            let a = 6 + 2 * slot;
            let mut map = DMatrix::<f64>::identity(before.nrows(), before.nrows());
            let mut added = DMatrix::<f64>::zeros(before.nrows(), before.nrows());
            map.view_mut((a, a), (2, 2)).fill(0.0);
            map.view_mut((a, 0), (2, 2)).copy_from(&gain.map(f64::from));
            added.view_mut((a, a), (2, 2)).copy_from(&own.map(f64::from));
            let expected = &map * before * map.transpose() + added;
            for i in 0..expected.nrows() {
                for j in 0..expected.ncols() {
                    let scale = (expected[(i, i)] * expected[(j, j)]).sqrt();
                    let off = (after[(i, j)] - expected[(i, j)]).abs();
                    assert!(off <= 1e-6 * scale, "slot {slot}, entry ({i}, {j}): off by {off:e}");
                }
            }
            let (_, mean, block) = filter.surface(slot).unwrap();
            assert_eq!(mean, Vector2::new(1.0, 2.0));
            assert_eq!(block.m12, block.m21);
        }
    }
}

#[test]
fn the_covariance_stays_positive_definite_when_what_is_inserted_says_little_of_its_own() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(32));
    let mut least = f64::INFINITY;
    for run in 0..200 {
        let mut filter = correlated(&mut noise);
        // Known to a millimetre given the tag, and up to ten times as far off as the tag is.
        let reach = 10f64.powf(noise.uniform());
        let mut entry = || (reach * (2.0 * noise.uniform() - 1.0)) as f32;
        let gain = Matrix2::new(entry(), entry(), entry(), entry());
        let own = Matrix2::new(1e-6, 0.0, 0.0, 1e-6);
        assert!(filter.insert_relative([1, 3][run % 2], Vector2::new(-4.0, 2.0), &gain, &own));
        least = least.min(least_pivot(&covariance(&filter)));
        assert!(least > 0.0, "run {run}: relative pivot {least:e}");
        for _ in 0..20 {
            filter.predict(0.1);
            let direct = [0, 1].map(|anchor| innovation(&filter, Source::Direct { anchor }, 5.0, 1e-4));
            filter.update(direct);
        }
        least = least.min(least_pivot(&covariance(&filter)));
        assert!(least > 0.0, "run {run}, later: relative pivot {least:e}");
    }
    println!("least relative pivot {least:.1e}");
}

#[test]
fn a_slot_that_is_taken_or_does_not_exist_takes_nothing() {
    let mut filter = correlated(&mut Noise(Xoshiro128PlusPlus::seed_from_u64(33)));
    let before = covariance(&filter);
    let unit = Matrix2::identity();
    assert!(!filter.insert_relative(2, Vector2::new(0.0, 0.0), &unit, &unit));
    assert!(!filter.insert_relative(5, Vector2::new(0.0, 0.0), &unit, &unit));
    assert_eq!(covariance(&filter), before);
}

/// The range's variance around what the position explains, for a height that is a mean with a deviation.
#[test]
fn a_heights_deviation_widens_a_range_as_drawn_heights_do() {
    let mut noise = Noise(Xoshiro128PlusPlus::seed_from_u64(3));
    let motion = cogmint_core::Config::default().motion;
    for (away_m, height_m, height_std_m) in
        [(3.0, 2.0, 0.2), (1.0, 2.0, 0.3), (6.0, -1.5, 0.5), (0.1, 3.0, 0.2), (4.0, 4.0, 0.0)]
    {
        let position_std_m = 0.05;
        let filter = StateFilter::<1, 1>::new(
            motion,
            30.0,
            [away_m as f32, 0.0],
            position_std_m as f32,
            0.1,
            0.0,
            0.0,
        );
        let regress = |height_std_m: f64| {
            let (height_m, height_std_m) = (height_m as f32, height_std_m as f32);
            let sight = Sight { anchor_m: [0.0, 0.0], height_m, height_std_m, lever_arm_m: [0.0; 2] };
            filter.regress(Source::Direct { anchor: 0 }, &sight, None).unwrap()
        };
        let draws: Vec<f64> = (0..200_000)
            .map(|_| {
                let [x, y] = [away_m + position_std_m * noise.normal(), position_std_m * noise.normal()];
                x.hypot(y).hypot(height_m + height_std_m * noise.normal())
            })
            .collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        let variance = draws.iter().map(|range| (range - mean).powi(2)).sum::<f64>() / draws.len() as f64;
        let (known, told) = (regress(0.0), regress(height_std_m));
        let ratio = f64::from(told.variance_m2()) / variance;
        let place = format!("{away_m} m away, {height_m} +- {height_std_m} m up: ratio {ratio:.3}");
        println!("{place}");
        // First order in the height: the draws have the second too. 200,000 draws leave 0.3 %.
        assert!((ratio - 1.0).abs() < 0.04, "{place}");
        // All of it is residual: it says nothing about where the tag is.
        assert_eq!(
            (known.range_m, known.slope, known.explained_m2),
            (told.range_m, told.slope, told.explained_m2)
        );
        assert_eq!(known.residual_m2 < told.residual_m2, height_std_m > 0.0, "{place}");
    }
    // At one height there is no slope: the range is what it was, to the bit.
    let filter = StateFilter::<1, 1>::new(motion, 30.0, [0.0, 0.0], 0.1, 0.1, 0.0, 0.0);
    let level =
        |height_std_m| Sight { anchor_m: [0.0, 0.0], height_m: 0.0, height_std_m, lever_arm_m: [0.0; 2] };
    let source = Source::Direct { anchor: 0 };
    assert_eq!(filter.regress(source, &level(0.0), None), filter.regress(source, &level(100.0), None));
}
