//! Figures of a run on the target: from the image, the firmware's log and the host's trace. Their budgets are in
//! `budgets.toml`, and `tests/budgets.sh` checks them.

use object::{Object, ObjectSection, ObjectSegment, ObjectSymbol};
use serde::Serialize;
use std::collections::BTreeMap;
use std::error::Error;
use std::process::ExitCode;

/// Stages in the order in which the firmware prints them.
const STAGES: [&str; 8] =
    ["receive", "estimate", "predict", "associate", "update", "remember", "discover", "act"];

#[derive(Serialize)]
struct Report {
    target: String,
    cycles: usize,
    /// Hash over all state after the last cycle: it depends on every cycle before.
    hash: String,
    host_hash: String,
    /// Whether the hashes of all cycles are equal.
    equal: bool,
    first_difference: Option<usize>,
    instructions_per_cycle: u64,
    instructions_per_cycle_max: u64,
    instructions_per_stage: BTreeMap<&'static str, u64>,
    /// Of the mean, all but input checks and channel estimation.
    instructions_without_estimate: u64,
    /// Static variables without the radio's frame buffer, and the deepest stack.
    ram_bytes: u64,
    /// All static variables, the frame buffer among them.
    static_bytes: u64,
    tracker_bytes: u64,
    /// The deepest stack from reset on, start included.
    stack_bytes: u64,
    /// The same until the tracker was started.
    start_stack_bytes: u64,
    frame_buffer_bytes: u64,
    flash_bytes: u64,
    /// Of that the core's: see [`core_flash_bytes`].
    flash_core_bytes: u64,
    panic_symbols: usize,
    heap_symbols: usize,
    /// The channel estimator alone.
    estimator: Estimator,
    /// The state filter alone, as published: 52 states.
    filter: Filter,
    /// The same with walls: 20 states.
    filter_walls: Filter,
    /// Images and availability alone.
    availability: Availability,
    /// Planning alone.
    planning: Planning,
    /// Smaller trackers.
    four_anchors: Smaller,
    one_anchor: Smaller,
    ranges_only: Smaller,
}

/// A smaller tracker, by an image of its own.
#[derive(Serialize)]
struct Smaller {
    cycles: usize,
    /// Whether the hashes of all cycles are equal to the host's.
    equal: bool,
    instructions_per_cycle: u64,
    /// Static variables without the radio's frame buffer, and the deepest stack from reset on.
    ram_bytes: u64,
    tracker_bytes: u64,
    stack_bytes: u64,
    start_stack_bytes: u64,
    flash_bytes: u64,
    flash_core_bytes: u64,
}

impl Smaller {
    fn read(image: &[u8], host: &str, log: &str) -> Result<Self, Box<dyn Error>> {
        let elf = object::File::parse(image)?;
        let run = Cycles::read(log)?;
        let host: Vec<&str> = host.lines().filter_map(|line| line.split_whitespace().nth(1)).collect();
        Ok(Self {
            cycles: run.hashes.len(),
            equal: run.hashes == host,
            instructions_per_cycle: run.per_stage.iter().flatten().sum::<u64>() / run.hashes.len() as u64,
            ram_bytes: static_bytes(&elf)? - run.frame_buffer_bytes + run.stack_bytes,
            tracker_bytes: run.tracker_bytes,
            stack_bytes: run.stack_bytes,
            start_stack_bytes: run.start_stack_bytes,
            flash_bytes: flash_bytes(&elf),
            flash_core_bytes: core_flash_bytes(&elf),
        })
    }
}

/// Everything that is loaded lies in flash, whatever its section's name.
fn flash_bytes(elf: &object::File<'_>) -> u64 {
    elf.segments().map(|segment| segment.file_range().1).sum()
}

/// Flash without what every firmware has of its own: the table of the chip's interrupts, and in place of its radio the feed's reader, the
/// host's files and the meters. What of the core is compiled into the replay is the core's, and so is the replay, and all that has no symbol.
fn core_flash_bytes(elf: &object::File<'_>) -> u64 {
    let vectors = elf.section_by_name(".vector_table").map_or(0, |section| section.size());
    let is_board = |name: &str| {
        let of = |module: &str| name.contains(&format!("cogmint_board{}{module}", module.len()));
        !name.contains("cogmint_core") && ["feed", "host", "meter"].into_iter().any(of)
    };
    let mut board = BTreeMap::new();
    for symbol in elf.symbols().filter(|symbol| symbol.kind() == object::SymbolKind::Text) {
        if symbol.name().is_ok_and(is_board) {
            board.insert(symbol.address(), symbol.size());
        }
    }
    flash_bytes(elf) - vectors - board.values().sum::<u64>()
}

/// Bytes of static variables.
fn static_bytes(elf: &object::File<'_>) -> Result<u64, Box<dyn Error>> {
    let end = elf.symbols().find(|symbol| symbol.name() == Ok("_stack_end")).map(|symbol| symbol.address());
    let end = end.ok_or("the image says not where its static variables end")?;
    let begin = elf.segments().map(|segment| segment.address()).filter(|address| *address <= end).max();
    Ok(end - begin.ok_or("the image has no static variables")?)
}

/// What one frame of 400 samples costs the channel estimator, over those in which it finds just eight paths.
#[derive(Serialize)]
struct Estimator {
    frames: usize,
    instructions: u64,
    instructions_max: u64,
    /// State, and the deepest stack of an estimate.
    state_and_scratch_bytes: u64,
}

impl Estimator {
    fn read(log: &str) -> Result<Self, Box<dyn Error>> {
        let mut counts: Vec<u64> = Vec::new();
        let mut state_and_scratch_bytes = 0;
        for line in log.lines() {
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["frame", "8", count] => counts.push(count.parse()?),
                ["frame", ..] => {}
                ["estimator", state, "stack", stack] => {
                    state_and_scratch_bytes = state.parse::<u64>()? + stack.parse::<u64>()?;
                }
                _ => eprintln!("target_report: the estimator's firmware said: {line}"),
            }
        }
        if counts.is_empty() || state_and_scratch_bytes == 0 {
            return Err("the estimator's firmware found no frame of eight paths, or did not end".into());
        }
        Ok(Self {
            frames: counts.len(),
            instructions: counts.iter().sum::<u64>() / counts.len() as u64,
            instructions_max: counts.iter().copied().max().unwrap_or(0),
            state_and_scratch_bytes,
        })
    }
}

/// What a step of 26 ranges costs the state filter.
#[derive(Serialize)]
struct Filter {
    steps: usize,
    /// Whether its bits are the host's after every step.
    equal: bool,
    instructions: u64,
    instructions_max: u64,
    instructions_predict: u64,
    instructions_regress: u64,
    instructions_update: u64,
    state_bytes: u64,
    stack_bytes: u64,
}

impl Filter {
    fn read(host: &str, log: &str) -> Result<Self, Box<dyn Error>> {
        let mut hashes = Vec::new();
        let mut counts: Vec<[u64; 3]> = Vec::new();
        let (mut state_bytes, mut stack_bytes) = (0, 0);
        for line in log.lines() {
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["step", _, "hash", hash, predict, regress, update] => {
                    hashes.push(hash.to_string());
                    counts.push([predict.parse()?, regress.parse()?, update.parse()?]);
                }
                ["filter", state, "stack", stack] => {
                    (state_bytes, stack_bytes) = (state.parse()?, stack.parse()?);
                }
                _ => eprintln!("target_report: the filter's firmware said: {line}"),
            }
        }
        if counts.is_empty() || state_bytes == 0 {
            return Err("the filter's firmware made no step, or did not end".into());
        }
        let steps = counts.len() as u64;
        let [predict, regress, update] =
            [0, 1, 2].map(|part| counts.iter().map(|counts| counts[part]).sum::<u64>() / steps);
        let host: Vec<&str> = host.lines().filter_map(|line| line.split_whitespace().nth(3)).collect();
        Ok(Self {
            steps: counts.len(),
            equal: hashes == host,
            instructions: predict + regress + update,
            instructions_max: counts.iter().map(|counts| counts.iter().sum()).max().unwrap_or(0),
            instructions_predict: predict,
            instructions_regress: regress,
            instructions_update: update,
            state_bytes,
            stack_bytes,
        })
    }
}

/// What images and availability of 24 sources over 8 walls cost at a place that is known within 0.1 m.
#[derive(Serialize)]
struct Availability {
    places: usize,
    instructions: u64,
    instructions_max: u64,
    /// What listing the sources of the plan took, once.
    instructions_listing: u64,
    stack_bytes: u64,
}

impl Availability {
    /// Places of the log that are known within 0.1 m; the others follow.
    const PLACES: usize = 20;

    fn read(log: &str) -> Result<Self, Box<dyn Error>> {
        let mut counts: Vec<u64> = Vec::new();
        let (mut listing, mut stack_bytes) = (0, 0);
        for line in log.lines() {
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["listed", _, count, "stack", _] => listing = count.parse()?,
                ["place", _, "hash", _, count] => counts.push(count.parse()?),
                ["walls", _, "stack", stack] => stack_bytes = stack.parse()?,
                _ => eprintln!("target_report: the availability's firmware said: {line}"),
            }
        }
        counts.truncate(Self::PLACES);
        if counts.len() < Self::PLACES || stack_bytes == 0 {
            return Err("the availability's firmware did not end".into());
        }
        Ok(Self {
            places: counts.len(),
            instructions: counts.iter().sum::<u64>() / counts.len() as u64,
            instructions_max: counts.iter().copied().max().unwrap_or(0),
            instructions_listing: listing,
            stack_bytes,
        })
    }
}

/// What a plan of 20 actions costs with two physical and 24 virtual anchors.
#[derive(Serialize)]
struct Planning {
    /// Whether its bits are the host's for every horizon.
    equal: bool,
    /// For horizons of one and five cycles.
    instructions: [u64; 2],
    stack_bytes: u64,
}

impl Planning {
    fn read(host: &str, log: &str) -> Result<Self, Box<dyn Error>> {
        let mut hashes = Vec::new();
        let mut instructions = Vec::new();
        let mut stack_bytes = 0;
        for line in log.lines() {
            match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                ["horizon", _, "hash", hash, count, "stack", stack] => {
                    hashes.push(hash.to_string());
                    instructions.push(count.parse()?);
                    stack_bytes = stack_bytes.max(stack.parse()?);
                }
                _ => eprintln!("target_report: the planning's firmware said: {line}"),
            }
        }
        let host: Vec<&str> = host.lines().filter_map(|line| line.split_whitespace().nth(3)).collect();
        let instructions = instructions.try_into().map_err(|_| "the planning's firmware did not end")?;
        Ok(Self { equal: hashes == host, instructions, stack_bytes })
    }
}

/// What the tracker's firmware printed.
#[derive(Debug)]
struct Cycles {
    hashes: Vec<String>,
    /// Instructions of every cycle.
    per_stage: Vec<[u64; STAGES.len()]>,
    start_stack_bytes: u64,
    stack_bytes: u64,
    tracker_bytes: u64,
    frame_buffer_bytes: u64,
}

impl Cycles {
    fn read(log: &str) -> Result<Self, Box<dyn Error>> {
        let mut hashes = Vec::new();
        let mut per_stage: Vec<[u64; STAGES.len()]> = Vec::new();
        let mut start_stack_bytes = 0;
        let mut end = None;
        for line in log.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["cycle", _, "hash", hash, counts @ ..] if counts.len() == STAGES.len() => {
                    hashes.push(hash.to_string());
                    let mut row = [0; STAGES.len()];
                    for (slot, count) in row.iter_mut().zip(counts) {
                        *slot = count.parse()?;
                    }
                    per_stage.push(row);
                }
                ["start", "stack", bytes] => start_stack_bytes = bytes.parse()?,
                ["stack", stack, "tracker", tracker, "frames", frames] => {
                    end = Some((stack.parse()?, tracker.parse()?, frames.parse()?));
                }
                ["error", ..] => return Err(format!("the firmware ended with: {line}").into()),
                _ => eprintln!("target_report: the firmware said: {line}"),
            }
        }
        let Some((stack_bytes, tracker_bytes, frame_buffer_bytes)) = end else {
            return Err("the firmware did not come to its end".into());
        };
        if hashes.is_empty() {
            return Err("the firmware printed no cycle".into());
        }
        Ok(Self { hashes, per_stage, start_stack_bytes, stack_bytes, tracker_bytes, frame_buffer_bytes })
    }
}

fn main() -> ExitCode {
    match report() {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("target_report: {error}");
            ExitCode::FAILURE
        }
    }
}

fn report() -> Result<bool, Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str| -> Result<String, String> {
        let at = arguments.iter().position(|a| a == name).ok_or_else(|| format!("needs {name}"))?;
        arguments.get(at + 1).cloned().ok_or_else(|| format!("{name} needs a value"))
    };
    let host = std::fs::read_to_string(value("--host")?)?;
    let log = std::fs::read_to_string(value("--log")?)?;
    let estimator = Estimator::read(&std::fs::read_to_string(value("--estimator-log")?)?)?;
    let filter = Filter::read(
        &std::fs::read_to_string(value("--filter-host")?)?,
        &std::fs::read_to_string(value("--filter-log")?)?,
    )?;
    let filter_walls = Filter::read(
        &std::fs::read_to_string(value("--walls-host")?)?,
        &std::fs::read_to_string(value("--walls-log")?)?,
    )?;
    let availability = Availability::read(&std::fs::read_to_string(value("--availability-log")?)?)?;
    let planning = Planning::read(
        &std::fs::read_to_string(value("--plan-host")?)?,
        &std::fs::read_to_string(value("--plan-log")?)?,
    )?;
    let smaller = |name: &str| {
        let text = |what: &str| {
            Ok::<_, Box<dyn Error>>(std::fs::read_to_string(value(&format!("--{name}-{what}"))?)?)
        };
        Smaller::read(&std::fs::read(value(&format!("--{name}-image"))?)?, &text("host")?, &text("log")?)
    };
    let image = std::fs::read(value("--image")?)?;
    let host_hashes: Vec<&str> = host.lines().filter_map(|line| line.split_whitespace().nth(1)).collect();

    let Cycles { hashes, per_stage, start_stack_bytes, stack_bytes, tracker_bytes, frame_buffer_bytes } =
        Cycles::read(&log)?;
    let first_difference = (0..hashes.len().max(host_hashes.len()))
        .find(|&n| hashes.get(n).map(String::as_str) != host_hashes.get(n).copied());

    let elf = object::File::parse(image.as_slice())?;
    let static_bytes = static_bytes(&elf)?;
    let linked = |parts: &[&str]| -> Vec<String> {
        let names = elf.symbols().filter_map(|symbol| symbol.name().ok().map(str::to_owned));
        names.filter(|name| parts.iter().any(|part| name.contains(part))).collect()
    };
    let panics = linked(&["panic", "unwrap_failed", "expect_failed", "slice_index_fail"]);
    let heap = linked(&["__rust_alloc", "__rust_realloc", "malloc", "__rg_alloc"]);

    let cycles = per_stage.len() as u64;
    let totals: Vec<u64> = per_stage.iter().map(|row| row.iter().sum()).collect();
    let mean = |values: &mut dyn Iterator<Item = u64>| values.sum::<u64>() / cycles;
    let mut instructions_per_stage = BTreeMap::new();
    for (stage, name) in STAGES.iter().enumerate() {
        instructions_per_stage.insert(*name, mean(&mut per_stage.iter().map(|row| row[stage])));
    }
    let instructions_per_cycle = mean(&mut totals.iter().copied());
    let report = Report {
        target: value("--target")?,
        cycles: hashes.len(),
        hash: hashes.last().cloned().unwrap_or_default(),
        host_hash: host_hashes.last().copied().unwrap_or_default().into(),
        equal: first_difference.is_none(),
        first_difference,
        instructions_per_cycle,
        instructions_without_estimate: instructions_per_cycle
            - instructions_per_stage["estimate"]
            - instructions_per_stage["receive"],
        instructions_per_cycle_max: totals.iter().copied().max().unwrap_or(0),
        ram_bytes: static_bytes - frame_buffer_bytes + stack_bytes,
        static_bytes,
        tracker_bytes,
        stack_bytes,
        start_stack_bytes,
        frame_buffer_bytes,
        flash_bytes: flash_bytes(&elf),
        flash_core_bytes: core_flash_bytes(&elf),
        panic_symbols: panics.len(),
        heap_symbols: heap.len(),
        instructions_per_stage,
        estimator,
        filter,
        filter_walls,
        availability,
        planning,
        four_anchors: smaller("four")?,
        one_anchor: smaller("one")?,
        ranges_only: smaller("ranges")?,
    };
    if arguments.iter().any(|a| a == "--json") {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print(&report);
    }
    for name in panics.iter().chain(&heap) {
        eprintln!("target_report: linked symbol {name}");
    }
    let equal = report.equal
        && report.filter.equal
        && report.filter_walls.equal
        && report.planning.equal
        && report.four_anchors.equal
        && report.one_anchor.equal
        && report.ranges_only.equal;
    Ok(equal && report.panic_symbols == 0 && report.heap_symbols == 0)
}

fn print(report: &Report) {
    println!("{} in QEMU, {} cycles", report.target, report.cycles);
    println!("hash after the last cycle  {}", report.hash);
    println!(
        "on the host                {}  {}",
        report.host_hash,
        if report.equal { "equal" } else { "NOT EQUAL" }
    );
    if let Some(cycle) = report.first_difference {
        println!("first different cycle      {cycle}");
    }
    println!("\ninstructions per cycle, by stage (mean)");
    for stage in STAGES {
        println!("  {stage:<10} {:>10}", report.instructions_per_stage[stage]);
    }
    println!(
        "\n{} instructions per cycle (mean), {} without input checks and channel estimation",
        report.instructions_per_cycle, report.instructions_without_estimate
    );
    println!(
        "flash {} bytes, of which the core has {}; {} panic symbols, {} of a heap",
        report.flash_bytes, report.flash_core_bytes, report.panic_symbols, report.heap_symbols
    );
    println!(
        "largest cycle {} instructions; RAM: static variables {} (the tracker {}) + stack {} bytes (start {}); frame \
         buffer beside it {} bytes",
        report.instructions_per_cycle_max,
        report.static_bytes - report.frame_buffer_bytes,
        report.tracker_bytes,
        report.stack_bytes,
        report.start_stack_bytes,
        report.frame_buffer_bytes
    );
    println!(
        "estimator alone: {} frames of just 8 paths, {} instructions (mean), {} in the largest; {} bytes of state and \
         scratch",
        report.estimator.frames,
        report.estimator.instructions,
        report.estimator.instructions_max,
        report.estimator.state_and_scratch_bytes
    );
    for (states, filter) in [(52, &report.filter), (20, &report.filter_walls)] {
        println!(
            "state filter alone: {} steps of {states} states and 26 ranges, bits {} the host's; predict {}, regress {}, \
             update {} instructions; {} bytes and {} of stack",
            filter.steps,
            if filter.equal { "equal to" } else { "NOT EQUAL to" },
            filter.instructions_predict,
            filter.instructions_regress,
            filter.instructions_update,
            filter.state_bytes,
            filter.stack_bytes
        );
    }
    println!(
        "images and availability alone: 24 sources over 8 walls, {} instructions (mean of {} places), {} in the largest; {} \
         for the list of sources; {} bytes of stack",
        report.availability.instructions,
        report.availability.places,
        report.availability.instructions_max,
        report.availability.instructions_listing,
        report.availability.stack_bytes
    );
    println!(
        "planning alone: 20 actions, 26 sources, bits {} the host's; {} / {} instructions over one and five cycles; {} \
         bytes of stack",
        if report.planning.equal { "equal to" } else { "NOT EQUAL to" },
        report.planning.instructions[0],
        report.planning.instructions[1],
        report.planning.stack_bytes
    );
    for (of, smaller) in [
        ("four anchors", &report.four_anchors),
        ("one anchor", &report.one_anchor),
        ("ranges only", &report.ranges_only),
    ] {
        println!(
            "{of}: {} cycles, bits {} the host's; RAM {} bytes: static variables with the tracker ({}) + stack {} (start {}); \
             flash {} bytes; {} instructions per cycle",
            smaller.cycles,
            if smaller.equal { "equal to" } else { "NOT EQUAL to" },
            smaller.ram_bytes,
            smaller.tracker_bytes,
            smaller.stack_bytes,
            smaller.start_stack_bytes,
            smaller.flash_bytes,
            smaller.instructions_per_cycle
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE: &str = "start stack 70\ncycle 0 hash 8090 1 2 3 4 5 6 7 700000000000\n";

    #[test]
    fn a_run_that_came_to_its_end_gives_its_figures() {
        let read = Cycles::read(&format!("{CYCLE}stack 80 tracker 20 frames 30\n")).unwrap();
        assert_eq!((read.stack_bytes, read.tracker_bytes, read.frame_buffer_bytes), (80, 20, 30));
        assert_eq!(read.per_stage, [[1, 2, 3, 4, 5, 6, 7, 700_000_000_000]]);
    }

    #[test]
    fn a_run_that_ended_with_an_error_gives_none() {
        let says = |log: String| Cycles::read(&log).unwrap_err().to_string();
        assert!(says(format!("{CYCLE}error the stack is used up\n")).contains("the stack is used up"));
        assert!(says(CYCLE.into()).contains("did not come to its end"));
        assert!(says("stack 80 tracker 20 frames 30\n".into()).contains("no cycle"));
    }
}
