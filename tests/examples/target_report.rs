//! Figures of a run on the target, beside their budgets: from the image, the firmware's log and the host's trace.

use object::{Object, ObjectSection, ObjectSymbol};
use serde::Serialize;
use std::collections::BTreeMap;
use std::error::Error;
use std::process::ExitCode;

/// Stages in the order in which the firmware prints them.
const STAGES: [&str; 8] =
    ["receive", "estimate", "predict", "associate", "update", "remember", "discover", "act"];

/// The state filter alone at full size: its must is a limit.
const FILTER_BUDGET: &str = "filter_52_states_26_ranges";
/// Planning alone at full size, over one and five cycles: their musts are limits.
const PLAN_BUDGETS: [&str; 2] = ["planning_20_actions_horizon_1", "planning_20_actions_horizon_5"];

/// Must and aim of the specification, section 6.
#[derive(Serialize)]
struct Budget {
    must: u64,
    aim: u64,
}

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
    /// Static variables without the radio's frame buffer, and the deepest stack.
    ram_bytes: u64,
    /// All static variables, the frame buffer among them.
    static_bytes: u64,
    tracker_bytes: u64,
    /// The deepest stack from reset on, construction included.
    stack_bytes: u64,
    /// The same until the tracker was constructed.
    constructor_stack_bytes: u64,
    frame_buffer_bytes: u64,
    flash_bytes: u64,
    panic_symbols: usize,
    /// The channel estimator alone.
    estimator: Estimator,
    /// The state filter alone.
    filter: Filter,
    /// Planning alone.
    planning: Planning,
    budgets: BTreeMap<&'static str, Budget>,
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

/// What a step of 52 states and 26 ranges costs the state filter.
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
    let planning = Planning::read(
        &std::fs::read_to_string(value("--plan-host")?)?,
        &std::fs::read_to_string(value("--plan-log")?)?,
    )?;
    let image = std::fs::read(value("--image")?)?;
    let host_hashes: Vec<&str> = host.lines().filter_map(|line| line.split_whitespace().nth(1)).collect();

    let mut hashes = Vec::new();
    let mut per_stage: Vec<[u64; STAGES.len()]> = Vec::new();
    let mut constructor_stack_bytes = 0;
    let mut end = None;
    for line in log.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["cycle", _, "hash", hash, counts @ ..] if counts.len() == STAGES.len() => {
                hashes.push(*hash);
                let mut row = [0; STAGES.len()];
                for (slot, count) in row.iter_mut().zip(counts) {
                    *slot = count.parse()?;
                }
                per_stage.push(row);
            }
            ["constructor", "stack", bytes] => constructor_stack_bytes = bytes.parse()?,
            ["stack", stack, "tracker", tracker, "frames", frames] => {
                end = Some((stack.parse::<u64>()?, tracker.parse()?, frames.parse::<u64>()?));
            }
            _ => eprintln!("target_report: the firmware said: {line}"),
        }
    }
    let Some((stack_bytes, tracker_bytes, frame_buffer_bytes)) = end else {
        return Err("the firmware did not come to its end".into());
    };
    if hashes.is_empty() {
        return Err("the firmware printed no cycle".into());
    }
    let first_difference =
        (0..hashes.len().max(host_hashes.len())).find(|&n| hashes.get(n) != host_hashes.get(n));

    let elf = object::File::parse(image.as_slice())?;
    let mut flash_bytes = 0;
    let mut static_bytes = 0;
    for section in elf.sections() {
        match section.name()? {
            ".vector_table" | ".text" | ".rodata" => flash_bytes += section.size(),
            ".data" => {
                flash_bytes += section.size();
                static_bytes += section.size();
            }
            ".bss" | ".uninit" => static_bytes += section.size(),
            _ => {}
        }
    }
    let panics: Vec<String> = elf
        .symbols()
        .filter_map(|symbol| symbol.name().ok().map(str::to_owned))
        .filter(|name| {
            ["panic", "unwrap_failed", "expect_failed", "slice_index_fail"].iter().any(|p| name.contains(p))
        })
        .collect();

    let cycles = per_stage.len() as u64;
    let totals: Vec<u64> = per_stage.iter().map(|row| row.iter().sum()).collect();
    let mean = |values: &mut dyn Iterator<Item = u64>| values.sum::<u64>() / cycles;
    let mut instructions_per_stage = BTreeMap::new();
    for (stage, name) in STAGES.iter().enumerate() {
        instructions_per_stage.insert(*name, mean(&mut per_stage.iter().map(|row| row[stage])));
    }
    let budget = |must, aim| Budget { must, aim };
    let report = Report {
        target: value("--target")?,
        cycles: hashes.len(),
        hash: hashes.last().copied().unwrap_or_default().into(),
        host_hash: host_hashes.last().copied().unwrap_or_default().into(),
        equal: first_difference.is_none(),
        first_difference,
        instructions_per_cycle: mean(&mut totals.iter().copied()),
        instructions_per_cycle_max: totals.iter().copied().max().unwrap_or(0),
        ram_bytes: static_bytes - frame_buffer_bytes + stack_bytes,
        static_bytes,
        tracker_bytes,
        stack_bytes,
        constructor_stack_bytes,
        frame_buffer_bytes,
        flash_bytes,
        panic_symbols: panics.len(),
        instructions_per_stage,
        estimator,
        filter,
        planning,
        budgets: BTreeMap::from([
            ("estimator_instructions_8_paths", budget(1_400_000, 700_000)),
            ("estimator_state_and_scratch_bytes", budget(16_384, 10_240)),
            ("instructions_per_cycle", budget(3_800_000, 1_900_000)),
            ("instructions_without_estimate", budget(1_000_000, 500_000)),
            ("instructions_predict_and_update", budget(280_000, 200_000)),
            (FILTER_BUDGET, budget(280_000, 200_000)),
            (PLAN_BUDGETS[0], budget(300_000, 100_000)),
            (PLAN_BUDGETS[1], budget(1_200_000, 400_000)),
            ("ram_bytes", budget(65_536, 32_768)),
            ("flash_bytes", budget(131_072, 65_536)),
            ("panic_symbols", budget(0, 0)),
        ]),
    };
    if arguments.iter().any(|a| a == "--json") {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print(&report);
    }
    for name in &panics {
        eprintln!("target_report: linked panic symbol {name}");
    }
    let limits = [FILTER_BUDGET, PLAN_BUDGETS[0], PLAN_BUDGETS[1]].map(|name| report.budgets[name].must);
    let [one, five] = report.planning.instructions;
    let within =
        [report.filter.instructions_max, one, five].iter().zip(limits).all(|(own, most)| *own <= most);
    if !within {
        eprintln!("target_report: the state filter or planning is beyond its budget");
    }
    let equal = report.equal && report.filter.equal && report.planning.equal;
    Ok(equal && within && report.panic_symbols == 0)
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
    println!("\n{:<34} {:>10} {:>10} {:>10}", "figure", "measured", "must", "aim");
    let stage = |name: &str| report.instructions_per_stage[name];
    let measured = |name: &str| match name {
        "instructions_per_cycle" => report.instructions_per_cycle,
        "instructions_without_estimate" => {
            report.instructions_per_cycle - stage("estimate") - stage("receive")
        }
        "instructions_predict_and_update" => stage("predict") + stage("update"),
        FILTER_BUDGET => report.filter.instructions,
        name if name == PLAN_BUDGETS[0] => report.planning.instructions[0],
        name if name == PLAN_BUDGETS[1] => report.planning.instructions[1],
        "estimator_instructions_8_paths" => report.estimator.instructions,
        "estimator_state_and_scratch_bytes" => report.estimator.state_and_scratch_bytes,
        "ram_bytes" => report.ram_bytes,
        "flash_bytes" => report.flash_bytes,
        _ => report.panic_symbols as u64,
    };
    for (name, budget) in &report.budgets {
        println!("{name:<34} {:>10} {:>10} {:>10}", measured(name), budget.must, budget.aim);
    }
    println!(
        "\nlargest cycle {} instructions; RAM: static variables {} (the tracker {}) + stack {} bytes (construction {}); frame \
         buffer beside it {} bytes",
        report.instructions_per_cycle_max,
        report.static_bytes - report.frame_buffer_bytes,
        report.tracker_bytes,
        report.stack_bytes,
        report.constructor_stack_bytes,
        report.frame_buffer_bytes
    );
    println!(
        "estimator alone: {} frames of just 8 paths, the largest {} instructions",
        report.estimator.frames, report.estimator.instructions_max
    );
    println!(
        "state filter alone: {} steps of 52 states and 26 ranges, bits {} the host's; predict {}, regress {}, update {} \
         instructions; {} bytes and {} of stack",
        report.filter.steps,
        if report.filter.equal { "equal to" } else { "NOT EQUAL to" },
        report.filter.instructions_predict,
        report.filter.instructions_regress,
        report.filter.instructions_update,
        report.filter.state_bytes,
        report.filter.stack_bytes
    );
    println!(
        "planning alone: 20 actions, 26 sources, bits {} the host's; {} bytes of stack",
        if report.planning.equal { "equal to" } else { "NOT EQUAL to" },
        report.planning.stack_bytes
    );
}
