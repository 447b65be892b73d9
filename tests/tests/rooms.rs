//! `cogmint experiment rooms`: the same rooms and figures on any number of threads, files that are ordinary scenarios,
//! and a tracker with the true associations that keeps the tag where it can be kept.

use cogmint_tests::{Folder, cogmint, command};
use serde_json::Value;

const SMALL: [&str; 9] =
    ["experiment", "rooms", "--count", "3", "--seed", "40", "--family", "stairwell,polygon", "--json"];

#[test]
fn the_figures_do_not_depend_on_the_number_of_threads() {
    let folder = Folder::new("rooms-threads");
    let on = |threads: &str| {
        let output = command(folder.path(), &SMALL).env("RAYON_NUM_THREADS", threads).output().expect("runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let (one, three) = (on("1"), on("3"));
    assert!(one == three);
    let answer: Value = serde_json::from_slice(&one).expect("is one JSON object");
    let names: Vec<&str> =
        answer["trackers"].as_array().unwrap().iter().map(|of| of["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["cogmint", "told", "direct", "ekf"]);
    assert_eq!(answer["runs"].as_array().unwrap().len(), 3 * names.len());
    assert_eq!(answer["rooms"], 3);
}

#[test]
fn written_rooms_are_scenario_files_and_a_bad_name_writes_none() {
    let folder = Folder::new("rooms-files");
    let run = |arguments: &[&str]| cogmint(folder.path(), arguments);
    let refused = run(&["experiment", "rooms", "--family", "castle", "--write", "none"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(!folder.path().join("none").exists());
    let drawn = run(&["experiment", "rooms", "--count", "2", "--seed", "7", "--draw", "--write", "some"]);
    assert!(drawn.status.success());
    for name in ["some/room-000007.toml", "some/room-000008.toml"] {
        assert!(run(&["scenario", "check", name]).status.success(), "{name}");
    }
}

/// The JSON object that a command prints.
fn answer(folder: &Folder, arguments: &str) -> Value {
    let output = cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("is one JSON object")
}

#[test]
fn incidents_befall_rooms_of_so_many_anchors_and_are_judged() {
    let folder = Folder::new("rooms-incidents");
    let run = |arguments: &str| cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    let rooms = "experiment rooms --count 2 --seed 40 --anchors 3 --plan 0.1 --start 1 --only direct --json";
    let answer = |incident: &str| answer(&folder, &format!("{rooms}{incident}"));
    let usual = answer("");
    assert!(usual.get("incident").is_none());
    assert!(
        usual["runs"]
            .as_array()
            .unwrap()
            .iter()
            .all(|run| run["anchors"] == 3 && run.get("heard_again_s").is_none())
    );
    let silent = answer(" --incident silence");
    assert_eq!(silent["incident"], "silence");
    for (run, before) in silent["runs"].as_array().unwrap().iter().zip(usual["runs"].as_array().unwrap()) {
        assert!(run["unheard_above_3_sigma"].is_number() && run["rmse_m"] != before["rmse_m"], "{run}");
        assert!(run["end_error_m"].is_number());
    }
    let figures = &silent["trackers"][0];
    assert!(figures["found_within_5_s_share"].is_number() && figures["unheard_lies_share"].is_number());
    assert_eq!(run(&format!("{rooms} --incident silence --write some")).status.code(), Some(2));
    assert_eq!(run(&format!("{rooms} --incident fire")).status.code(), Some(2));
}

#[test]
fn defects_of_the_radio_are_the_same_for_all_trackers_and_said() {
    let folder = Folder::new("rooms-defects");
    let run = |arguments: &str| cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    let rooms = "experiment rooms --count 1 --seed 40 --plan 0.1 --start 1 --only told,direct --json";
    let answer = |defect: &str| answer(&folder, &format!("{rooms}{defect}"));
    let usual = answer("");
    assert!(usual.get("defect").is_none() && usual["runs"][0].get("defect").is_none());
    for defect in ["pulse-long", "peak-late", "eight-bit", "side-lobes"] {
        let spoilt = answer(&format!(" --defect {defect}"));
        assert_eq!((&spoilt["defect"], &spoilt["runs"][0]["defect"]), (&defect.into(), &defect.into()));
        // The same rooms are answerable, and no tracker is spared.
        assert_eq!(spoilt["answerable"], usual["answerable"]);
        for (run, before) in spoilt["runs"].as_array().unwrap().iter().zip(usual["runs"].as_array().unwrap())
        {
            assert!(run["rmse_m"].is_number() && run["rmse_m"] != before["rmse_m"], "{defect}: {run}");
        }
    }
    assert_eq!(run(&format!("{rooms} --defect rust")).status.code(), Some(2));
    assert_eq!(run(&format!("{rooms} --defect eight-bit --incident silence")).status.code(), Some(2));
    assert_eq!(run(&format!("{rooms} --defect eight-bit --write some")).status.code(), Some(2));
}

#[test]
fn settings_of_the_belief_are_changed_by_name_and_said() {
    let folder = Folder::new("rooms-settings");
    let run = |arguments: &str| cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    let rooms =
        "experiment rooms --count 1 --seed 41 --anchors 2 --plan 0.1 --start 1 --only cogmint,told --json";
    let answer = |settings: &str| answer(&folder, &format!("{rooms}{settings}"));
    let usual = answer("");
    assert!(usual.get("belief").is_none());
    for setting in ["components=2", "walls_hide_paths=0", "turns_per_s=0"] {
        let changed = answer(&format!(" --belief {setting}"));
        assert_eq!(changed["belief"], serde_json::json!([setting]));
        let errors = |answer: &Value, tracker: &str| -> Vec<Value> {
            let runs = answer["runs"].as_array().unwrap().iter();
            runs.filter(|run| run["tracker"] == tracker).map(|run| run["rmse_m"].clone()).collect()
        };
        assert_ne!(errors(&changed, "cogmint"), errors(&usual, "cogmint"), "{setting}");
        assert_eq!(errors(&changed, "told"), errors(&usual, "told"), "{setting}");
    }
    // What is no setting, and what is out of range.
    assert_eq!(run(&format!("{rooms} --belief mood=1")).status.code(), Some(2));
    assert_eq!(run(&format!("{rooms} --belief components=0")).status.code(), Some(2));
    assert_eq!(run(&format!("{rooms} --belief split_above_m=-1")).status.code(), Some(2));
}

/// The yardstick itself: in answerable rooms whoever is told the associations keeps the tag, and says how well.
#[test]
fn told_associations_keep_the_tag_in_answerable_rooms() {
    let folder = Folder::new("rooms-told");
    let arguments =
        "experiment rooms --count 30 --seed 300 --start 0.25,1 --plan exact,0.1 --only told --json";
    let output = cogmint(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    let answer: Value = serde_json::from_slice(&output.stdout).expect("is one JSON object");
    let answerable = answer["answerable"].as_u64().unwrap();
    let told = &answer["trackers_answerable"][0];
    println!("{answerable} answerable: {told}");
    assert!(answerable >= 10, "{answerable}");
    assert!(told["lost_share"].as_f64().unwrap() <= 0.07, "{told}");
    assert!((0.3..4.0).contains(&told["nees_median"].as_f64().unwrap()), "{told}");
    // No tracker comes below what the frames allow, in the median.
    assert!(told["ratio_to_bound_median"].as_f64().unwrap() > 1.0, "{told}");
}
