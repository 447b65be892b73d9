//! Where values lie and how far they scatter.

use serde::Serialize;

/// The deviation of a normal distribution over its median absolute deviation.
const NORMAL: f64 = 1.4826;

/// Location and spread of values, with and without trust in the outermost ones. The unit is that of the values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Number of values.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Standard deviation (unbiased variance); zero of a single value.
    pub std: f64,
    /// 1.4826 times the median absolute deviation from the median.
    pub robust_std: f64,
    /// Root mean square.
    pub rms: f64,
}

impl Spread {
    /// Of at least one value; all finite.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let values: Vec<f64> = values.into_iter().collect();
        let median = median(values.iter().copied())?;
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        Some(Self {
            count: values.len(),
            mean,
            median,
            std: (squares / (count - 1.0).max(1.0)).sqrt(),
            robust_std: NORMAL * self::median(values.iter().map(|value| (value - median).abs()))?,
            rms: (values.iter().map(|value| value * value).sum::<f64>() / count).sqrt(),
        })
    }
}

/// The median: the mean of the two middle values where their number is even.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let high = *values.get(values.len() / 2)?;
    let low = *values.get((values.len() - 1) / 2)?;
    Some(0.5 * (low + high))
}

/// The least value that at least the share `share` of them do not exceed; none of none.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_wild_value_moves_the_deviation_and_not_the_robust_one() {
        let calm = Spread::of([1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        let wild = Spread::of([1.0, 2.0, 3.0, 4.0, 500.0]).unwrap();
        assert_eq!((calm.median, calm.mean), (3.0, 3.0));
        assert!((calm.std - 2.5f64.sqrt()).abs() < 1e-12);
        assert_eq!((wild.median, wild.robust_std), (3.0, calm.robust_std));
        assert!(wild.std > 200.0);
    }

    #[test]
    fn nothing_has_no_spread_and_one_value_none_to_speak_of() {
        assert_eq!(Spread::of([]), None);
        assert_eq!(Spread::of([7.0]).map(|spread| (spread.median, spread.std)), Some((7.0, 0.0)));
        assert_eq!(median([1.0, 4.0]), Some(2.5));
        assert_eq!((quantile(&[3.0, 1.0, 2.0, 4.0], 0.75), quantile(&[], 0.5)), (Some(3.0), None));
    }
}
