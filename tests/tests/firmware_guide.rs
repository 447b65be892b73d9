//! The guide to firmware shows what `cogmint plan` makes of the plan that it shows. Its Rust is compiled with the documentation's tests.

use cogmint::floor_plan::export::Export;
use cogmint::scenario::Scenario;
use cogmint_tests::root;

#[test]
fn the_constants_shown_are_those_of_the_plan_shown() {
    let guide = std::fs::read_to_string(root().join("docs/firmware.md")).unwrap();
    let block = |language: &str| {
        let after = guide.split_once(&format!("```{language}\n")).unwrap().1;
        after.split_once("```").unwrap().0
    };
    let scenario = Scenario::parse(block("toml"), "docs/firmware.md").unwrap();
    let rust = Export::of_scenario(&scenario, None).unwrap().to_rust();
    assert_eq!(block("rust"), rust, "{rust}");
}
