//! Figures over several runs.

/// Mean; NaN of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean; none of nothing.
pub fn mean_of(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| mean(&values))
}

/// The quantile between the nearest ranks; none of nothing and where it is infinite.
pub fn quantile(share: f64, values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let place = share * sorted.len().checked_sub(1)? as f64;
    let (below, above) = (sorted[place.floor() as usize], sorted[place.ceil() as usize]);
    // Where both are one, infinities must not meet in a difference.
    let value = if below == above { below } else { below + place.fract() * (above - below) };
    value.is_finite().then_some(value)
}

/// Standard error of the mean; 0 where there is one value or none.
pub fn standard_error(values: &[f64]) -> f64 {
    let count = values.len() as f64;
    if count < 2.0 {
        return 0.0;
    }
    let middle = mean(values);
    let squares: f64 = values.iter().map(|value| (value - middle) * (value - middle)).sum();
    (squares / (count - 1.0) / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_ranks_and_what_is_infinite_has_none() {
        assert_eq!(quantile(0.5, [3.0, 1.0, 2.0].into_iter()), Some(2.0));
        assert_eq!(quantile(0.5, [1.0, 2.0].into_iter()), Some(1.5));
        assert_eq!(quantile(0.5, [1.0, f64::INFINITY, f64::INFINITY].into_iter()), None);
        assert_eq!(quantile(0.0, [1.0, f64::INFINITY].into_iter()), Some(1.0));
        assert_eq!(quantile(0.5, std::iter::empty()), None);
    }
}
