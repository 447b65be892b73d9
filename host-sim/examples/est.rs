//! scratch
use cogmint_core::{observation::Samples, perceptor::channel_estimator::*, pulse::Pulse};
use rand_core::{Rng, SeedableRng};
struct G(rand_xoshiro::Xoshiro128PlusPlus);
impl G {
    fn u(&mut self) -> f64 {
        (self.0.next_u32() as f64 + 0.5) / 4294967296.0
    }
    fn cn(&mut self) -> [f64; 2] {
        let r = (-self.u().ln()).sqrt();
        let a = std::f64::consts::TAU * self.u();
        [r * a.cos(), r * a.sin()]
    }
}
fn rrc(x: f64, b: f64) -> f64 {
    // unit energy Tp=1
    let pi = std::f64::consts::PI;
    if x.abs() < 1e-9 {
        return 1.0 + b * (4.0 / pi - 1.0);
    }
    let d = 1.0 - (4.0 * b * x).powi(2);
    if d.abs() < 1e-6 {
        return b / 2f64.sqrt()
            * ((1.0 + 2.0 / pi) * (pi / (4.0 * b)).sin() + (1.0 - 2.0 / pi) * (pi / (4.0 * b)).cos());
    }
    ((pi * x * (1.0 - b)).sin() + 4.0 * b * x * (pi * x * (1.0 + b)).cos()) / (pi * x * d)
}
fn main() {
    let p = Pulse { duration_s: 0.5e-9, roll_off: 0.6 };
    let mut g = G(rand_xoshiro::Xoshiro128PlusPlus::seed_from_u64(5));
    let n = 400;
    let taps: Vec<f64> = (-32..=32).map(|k| rrc(k as f64 * 0.5, 0.6) * (0.5f64).sqrt()).collect();
    let frame = |g: &mut G, paths: &[(f64, [f64; 2])], omega: f64, onset: f64| -> Vec<[f32; 2]> {
        // white noise + DM in pre-MF domain at Ts=Tp/2, MF with rrc
        let mut w: Vec<[f64; 2]> = (0..n + 64)
            .map(|i| {
                let t = (i as f64 - 32.0) * 0.25 - onset;
                let mut s = 1.0;
                let _ = &mut s;
                let v = g.cn();
                [v[0], v[1]]
                    .map(|x| x * s)
                    .into_iter()
                    .collect::<Vec<_>>()
                    .try_into()
                    .map(|a: [f64; 2]| {
                        let _ = t;
                        a
                    })
                    .unwrap()
            })
            .collect();
        let mut y: Vec<[f64; 2]> = (0..n)
            .map(|i| {
                let mut a = [0.0; 2];
                for (k, t) in taps.iter().enumerate() {
                    a[0] += t * w[i + k][0];
                    a[1] += t * w[i + k][1];
                }
                a
            })
            .collect();
        if omega > 0.0 {
            // DM through R
            w.iter_mut().enumerate().for_each(|(i, v)| {
                let t = (i as f64 - 32.0) * 0.25 - onset;
                let prof =
                    if t < 0.0 { 0.0 } else { (1.0 - 0.98 * (-t / 5.0f64).exp()) * (-t / 20.0f64).exp() };
                let c = g.cn();
                let s = (omega * prof).sqrt();
                *v = [c[0] * s, c[1] * s];
            });
            for i in 0..n {
                for k in 0..65 {
                    let x = (k as f64 - 32.0) * 0.5;
                    let r = p.autocorrelation(x as f32) as f64;
                    y[i][0] += r * w[i + k][0];
                    y[i][1] += r * w[i + k][1];
                }
            }
        }
        for (d, a) in paths {
            for i in 0..n {
                let r = p.autocorrelation(((i as f64 * 0.25 - d) / 0.5) as f32) as f64;
                y[i][0] += a[0] * r;
                y[i][1] += a[1] * r;
            }
        }
        y.iter().map(|v| [v[0] as f32, v[1] as f32]).collect()
    };
    for rate in [0.01f32, 1.0] {
        let e = ChannelEstimator::<16>::new(p, 0.25e-9, n, rate);
        for db in [12.0, 15.0, 20.0, 30.0f64] {
            let mut se = 0.0;
            let mut cnt = 0;
            let mut fa = 0;
            let mut si = vec![];
            for _ in 0..1000 {
                let d = 40.0 + g.u();
                let ph = std::f64::consts::TAU * g.u();
                let a = 10f64.powf(db / 20.0);
                let f = frame(&mut g, &[(d, [a * ph.cos(), a * ph.sin()])], 0.0, 0.0);
                let r = e.estimate(Samples::Complex(&f), 0.0);
                let mut hit = false;
                for q in &r.paths {
                    let er = q.delay_s as f64 * 1e9 - d;
                    if er.abs() < 0.25 && !hit {
                        hit = true;
                        se += er * er;
                        cnt += 1;
                        si.push(10.0 * q.sinr.log10());
                    } else {
                        fa += 1
                    }
                }
            }
            si.sort_by(f32::total_cmp);
            let crlb = 1e9
                / (8.0 * std::f64::consts::PI.powi(2) * 633.66e6f64.powi(2) * 10f64.powf(db / 10.0)).sqrt();
            println!(
                "rate {rate} snr {db}: det {cnt} rmse/crlb {:.3} false {:.4} sinr med {:.2}",
                (se / cnt as f64).sqrt() / crlb,
                fa as f64 / 1000.0,
                si.get(si.len() / 2).unwrap_or(&0.0)
            );
        }
        let mut fa = 0;
        for _ in 0..1000 {
            let f = frame(&mut g, &[], 0.0, 0.0);
            fa += e.estimate(Samples::Complex(&f), 0.0).paths.len();
        }
        println!("noise only {}", fa as f64 / 1000.0);
        for sep in [0.5, 0.7, 1.0f64] {
            let mut two = 0;
            for _ in 0..1000 {
                let d = 40.0 + g.u();
                let a = 10f64.powf(25.0 / 20.0);
                let (p1, p2) = (std::f64::consts::TAU * g.u(), std::f64::consts::TAU * g.u());
                let f = frame(
                    &mut g,
                    &[(d, [a * p1.cos(), a * p1.sin()]), (d + sep * 0.5, [a * p2.cos(), a * p2.sin()])],
                    0.0,
                    0.0,
                );
                if e.estimate(Samples::Complex(&f), 0.0).paths.len() == 2 {
                    two += 1
                }
            }
            println!("rate {rate} two at {sep}: {two}");
        }
        // 7 paths in DM
        let taus = [10.0, 14.3, 19.1, 25.7, 33.3, 41.9, 55.0f64];
        let mut hits = [0; 7];
        let mut fa = 0;
        let t0 = std::time::Instant::now();
        // LOS SNR 35 dB, DM total -10 dB => sum over samples of dm power
        let los = 10f64.powf(35.0 / 10.0);
        let integral: f64 = (0..400)
            .map(|i| {
                let t = i as f64 * 0.25;
                (1.0 - 0.98 * (-t / 5.0f64).exp()) * (-t / 20.0f64).exp()
            })
            .sum();
        // DM energy relative: sum of scatterer powers = -10 dB LOS
        let omega = los * 0.1 / integral;
        let lev = |t: f64| {
            let x = t - 10.0;
            if x < 0.0 {
                1.0
            } else {
                1.0 + omega * 2.0 * 0.85 * (1.0 - 0.98 * (-x / 5.0f64).exp()) * (-x / 20.0f64).exp()
            }
        };
        let sin = [f64::NAN, 20.0, 18.0, 14.0, 12.6, 11.3, 8.2];
        let amps: Vec<f64> = (0..7)
            .map(|k| if k == 0 { los.sqrt() } else { (lev(taus[k]) * 10f64.powf(sin[k] / 10.0)).sqrt() })
            .collect();
        for _ in 0..500 {
            let ps: Vec<(f64, [f64; 2])> = (0..7)
                .map(|k| {
                    let a = std::f64::consts::TAU * g.u();
                    (taus[k] + 0.1 * g.u(), [amps[k] * a.cos(), amps[k] * a.sin()])
                })
                .collect();
            let f = frame(&mut g, &ps, omega, 10.0);
            let r = e.estimate(Samples::Complex(&f), 0.0);
            for q in &r.paths {
                let t = q.delay_s as f64 * 1e9;
                match ps.iter().position(|x| (x.0 - t).abs() < 0.25) {
                    Some(k) => hits[k] += 1,
                    None => fa += 1,
                }
            }
        }
        println!(
            "seven: det {:?} false {:.4} us {:.1}",
            hits.map(|h| h as f64 / 500.0),
            fa as f64 / 500.0,
            t0.elapsed().as_secs_f64() * 1e6 / 500.0
        );
    }
}
