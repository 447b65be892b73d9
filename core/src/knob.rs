//! Temporary.
extern crate std;
/// K
pub fn knob(i: usize) -> f32 {
    static K: std::sync::OnceLock<std::vec::Vec<f32>> = std::sync::OnceLock::new();
    // 0 cap, 1 persist, 2 split m, 3 turn factor, 4 newcomers, 5 eps, 6 branches, 7 amb, 8 info, 9 keep nat, 10 merge, 11 mergev,
    // 12 barrier, 13 outline, 14 conf, 15 arcs, 16 period, 17 join nat, 18 heavy tail w, 19 heavy tail pulses, 20 floor pulses
    let d = [8.0f32, 0.0, 0.15, 1.0, 4.0, 1e-4, 6.0, 0.05, 0.3, 25.0, 0.5, 0.7, 1.0, 1.0, 0.9, 32.0, 5.0, 7.0, 0.0, 0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    K.get_or_init(|| (0..30).map(|i| std::env::var(std::format!("K{i}")).ok().and_then(|v| v.parse().ok()).unwrap_or(d[i])).collect())[i]
}
