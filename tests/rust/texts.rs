//! Settings, recordings and estimates as text, through serde.

use ddmhe_core::{
    Bounds, Config, DdMhe, Estimate, Gate, History, ProcessNoise, Soft, Space, Start, Weighting,
};

fn history() -> History {
    let x: Vec<f64> = (0..=60).map(|k| 1.0 + 0.3 * (0.7 * f64::from(k)).sin()).collect();
    let y: Vec<f64> = x[..60].iter().map(|x| 2.0 * x + 0.1).collect();
    let u: Vec<f64> = (0..60).map(|k| f64::from(k % 7)).collect();
    let free = History::new(1, 1, &x, &y, 0.1).unwrap().with_units(&["rad/s"], &["V"]).unwrap();
    free.with_inputs(1, &u).unwrap().with_input_units(&["A"]).unwrap()
}

#[test]
fn a_config_is_the_defaults_with_what_is_written() {
    let config: Config = serde_json::from_str("{}").unwrap();
    assert_eq!(config, Config::default());
    let config: Config = serde_json::from_str(
        r#"{"horizon": 12, "weights": "scaled", "x_bounds": {"lo": [-1.5], "hi": [1.5]},
            "process_noise": {"given": [0.25]}, "soft": {"x": 3.0}, "start": "unknown",
            "space": {"truncated": {"rank": 2}}, "gate": {"at": 4.5}, "evidence": true}"#,
    )
    .unwrap();
    let expected = Config {
        horizon: Some(12),
        weights: Weighting::Scaled,
        x_bounds: Some(Bounds { lo: vec![-1.5], hi: vec![1.5] }),
        process_noise: ProcessNoise::Given(vec![0.25]),
        soft: Some(Soft { x: Some(3.0), v: None, w: None }),
        start: Start::Unknown,
        space: Space::Truncated { rank: Some(2), tol: None },
        gate: Gate::At(4.5),
        ..Config::default()
    };
    assert_eq!(config, expected);
    let again: Config = serde_json::from_str(&serde_json::to_string(&config).unwrap()).unwrap();
    assert_eq!(again, config);
}

#[test]
fn a_misspelt_setting_is_an_error_that_names_it() {
    for (text, name) in [
        (r#"{"horizn": 12}"#, "horizn"),
        (r#"{"soft": {"z": 1.0}}"#, "`z`"),
        (r#"{"x_bounds": {"lo": [0.0], "hi": [1.0], "high": [2.0]}}"#, "high"),
        (r#"{"start": "anywhere"}"#, "anywhere"),
    ] {
        let words = serde_json::from_str::<Config>(text).unwrap_err().to_string();
        assert!(words.contains(name), "{words}");
    }
}

#[test]
fn a_history_comes_back_bit_for_bit_and_is_checked_like_one_that_is_made() {
    let history = history();
    let text = serde_json::to_string(&history).unwrap();
    assert_eq!(serde_json::from_str::<History>(&text).unwrap(), history);
    for (from, to, named) in [
        (r#""dt":0.1"#, r#""dt":-0.1"#, "dt"),
        (r#""n":1"#, r#""n":2"#, "x"),
        (r#""x_units":["rad/s"]"#, r#""x_units":["rad","s"]"#, "x_units"),
        (r#""m":1"#, r#""m":3"#, "u"),
    ] {
        assert!(text.contains(from));
        let words = serde_json::from_str::<History>(&text.replacen(from, to, 1)).unwrap_err();
        assert!(words.to_string().starts_with(named), "{words}");
    }
}

#[test]
fn an_estimate_and_the_settings_in_force_are_texts_too() {
    let mut mhe = DdMhe::new(&history(), Config::default()).unwrap();
    let signals = ddmhe_core::Step { y: &[2.3], u: &[1.0], x_bounds: None };
    let estimate = mhe.step_with(signals).unwrap().clone();
    let text = serde_json::to_string(&estimate).unwrap();
    assert_eq!(serde_json::from_str::<Estimate>(&text).unwrap(), estimate);
    let settings = serde_json::to_value(mhe.settings()).unwrap();
    assert_eq!(settings["horizon"], mhe.settings().horizon);
    assert!(settings["why"].is_array());
}
