//! scratch
use cogmint::{recording::Recording, replay::*, score::Score};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let dir = std::path::Path::new(&a[1]);
    let r = Recording::read(dir).unwrap();
    let seeds: Vec<Option<u64>> = match a.get(2) {
        Some(n) => (1..=n.parse::<u64>().unwrap()).map(Some).collect(),
        None => vec![None],
    };
    for s in seeds {
        let setup = Setup::new(&r, dir, s).unwrap();
        let mut t = setup.tracker::<8>().unwrap();
        let (mut e, mut sec, mut refd) = (vec![], 0.0, 0);
        for (i, inp) in inputs(&r).enumerate() {
            let st = step(&mut t, &inp, &mut ()).unwrap();
            sec += st.seconds;
            if st.refused.is_some() {
                refd += 1;
                if refd == 1 {
                    eprintln!("{:?}", st.refused);
                }
            }
            if let Some(p) = r.cycles[i].truth_position_m {
                e.push((p[0] - st.report.position_m[0] as f64).hypot(p[1] - st.report.position_m[1] as f64));
            }
            if a.len() > 3 && st.report.discovered > 0 {
                eprintln!("{i} discovered");
            }
        }
        let n = t.environment().iter().filter(|(_, r)| r.existence > 0.5).count();
        let sc = Score::new(r.cycles.len(), &e, sec);
        println!(
            "{s:?} rmse {:.3} p95 {:.3} max {:.3} end {:.3} div {} us {:.1} vas {n} refused {refd} bias {:?}",
            sc.rmse_m.unwrap_or(-1.),
            sc.p95_m.unwrap_or(-1.),
            sc.max_m.unwrap_or(-1.),
            e.last().copied().unwrap_or(-1.),
            sc.diverged,
            sc.us_per_cycle,
            (0..6).map(|j| t.filter().bias_m(j).unwrap().0).collect::<Vec<_>>()
        );
    }
}
