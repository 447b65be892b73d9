//! Optimal assignment: which row goes with which column so that the total cost is least.

/// The cheapest pairing of rows with columns, each used once at most and as many pairs as possible: per row the
/// index of its column, none for rows left over where there are more rows than columns.
///
/// `cost(row, column)` must be finite. Shortest augmenting paths with dual prices (Kuhn 1955, Munkres 1957, in the
/// O(n^3) form of Jonker and Volgenant 1987).
pub fn cheapest(rows: usize, columns: usize, cost: impl Fn(usize, usize) -> f64) -> Vec<Option<usize>> {
    if rows > columns {
        return partners_of_columns(columns, rows, |a, b| cost(b, a));
    }
    let mut column_of = vec![None; rows];
    for (column, row) in partners_of_columns(rows, columns, cost).into_iter().enumerate() {
        if let Some(row) = row {
            column_of[row] = Some(column);
        }
    }
    column_of
}

/// The cheapest pairing where there are no more rows than columns: every row has a partner; per column the row.
fn partners_of_columns(
    rows: usize,
    columns: usize,
    cost: impl Fn(usize, usize) -> f64,
) -> Vec<Option<usize>> {
    let mut row_price = vec![0.0; rows];
    let mut column_price = vec![0.0; columns];
    let mut row_of: Vec<Option<usize>> = vec![None; columns];
    for start in 0..rows {
        // Dijkstra over the reduced costs from the new row to the nearest free column.
        let mut distance = vec![f64::INFINITY; columns];
        let mut came_from: Vec<Option<usize>> = vec![None; columns];
        let mut settled = vec![false; columns];
        let (mut row, mut last, mut travelled) = (start, None, 0.0);
        let end = loop {
            for column in (0..columns).filter(|column| !settled[*column]) {
                let through = travelled + cost(row, column) - row_price[row] - column_price[column];
                if through < distance[column] {
                    distance[column] = through;
                    came_from[column] = last;
                }
            }
            let open = (0..columns).filter(|column| !settled[*column]);
            let nearest = open.min_by(|a, b| distance[*a].total_cmp(&distance[*b]));
            // No more rows than columns: one is open as long as rows wait.
            let Some(nearest) = nearest else { return row_of };
            travelled = distance[nearest];
            settled[nearest] = true;
            last = Some(nearest);
            match row_of[nearest] {
                Some(next) => row = next,
                None => break nearest,
            }
        };
        row_price[start] += travelled;
        for column in (0..columns).filter(|column| settled[*column] && *column != end) {
            let slack = travelled - distance[column];
            column_price[column] -= slack;
            if let Some(owner) = row_of[column] {
                row_price[owner] += slack;
            }
        }
        let mut column = end;
        while let Some(previous) = came_from[column] {
            row_of[column] = row_of[previous];
            column = previous;
        }
        row_of[column] = Some(start);
    }
    row_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::random::{Purpose, stream, uniform};

    /// The least cost of pairing `rows` with distinct free columns, by trying all.
    fn by_enumeration(costs: &[Vec<f64>], taken: &mut [bool], row: usize, skips: usize) -> f64 {
        if row == costs.len() {
            return 0.0;
        }
        let mut least = f64::INFINITY;
        if skips > 0 {
            least = by_enumeration(costs, taken, row + 1, skips - 1);
        }
        for column in 0..taken.len() {
            if !taken[column] {
                taken[column] = true;
                least = least.min(costs[row][column] + by_enumeration(costs, taken, row + 1, skips));
                taken[column] = false;
            }
        }
        least
    }

    #[test]
    fn no_pairing_is_cheaper_than_the_one_found() {
        let mut rng = stream(5, Purpose::Experiment, &[]);
        for trial in 0..2000 {
            let (rows, columns) = (trial % 7, trial / 7 % 7);
            // Half the trials hold many ties, as cut-off distances do, and negative costs.
            let levels = if trial % 2 == 0 { 3.0 } else { 1e6 };
            let costs: Vec<Vec<f64>> = (0..rows)
                .map(|_| (0..columns).map(|_| (uniform(&mut rng) * levels).floor() - 1.0).collect())
                .collect();
            let columns_of = cheapest(rows, columns, |row, column| costs[row][column]);
            let mut seen = vec![false; columns];
            let mut total = 0.0;
            for (row, column) in columns_of.iter().enumerate() {
                if let Some(column) = *column {
                    assert!(!std::mem::replace(&mut seen[column], true), "column {column} is used twice");
                    total += costs[row][column];
                }
            }
            assert_eq!(columns_of.iter().flatten().count(), rows.min(columns));
            let least = by_enumeration(&costs, &mut vec![false; columns], 0, rows.saturating_sub(columns));
            assert_eq!(total, least, "trial {trial}: {costs:?}");
        }
    }
}
