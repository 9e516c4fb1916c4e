//! What an estimator computes at construction: settings, weights and the problems of all depths.

use crate::challenge::challenge;
use crate::choices::{guarded, leaves_all_open, prepared, select, spectral_radius};
use crate::config::{Bounds, Center, Config, Equilibrium, Settings, Stuck, Weighting};
use crate::defaults::Defaults;
use crate::depths::{depths, places};
use crate::driving::Driving;
use crate::error::Error;
use crate::error_bound::ErrorBound;
use crate::evidence::replay::Setup;
use crate::evidence::{self, Calibration, stated_beyond};
use crate::excitation::check_excitation;
use crate::first_window::{filled, first_window};
use crate::history::History;
use crate::inputs::InputWatch;
use crate::magnitude::{check_ridge, check_weights};
use crate::needs::{Needs, gate};
use crate::plan_builder::{Draft, Ground, Prepared};
use crate::process_noise::driving;
use crate::recorded_default;
use crate::reduction::factorisation;
use crate::remarks::Remarks;
use crate::response::OwnResponse;
use crate::scaling::Scaling;
use crate::space::{Selection, TrajectorySpace, WindowStack};
use crate::start::{Opening, opening_weights};
use crate::variation::Rest;
use crate::watch::Watch;
use crate::weights::Weights;
use crate::why::{stated_weights, why};
use ddmhe_run::layout::Layout;
use ddmhe_run::plan::Sizes;
use std::sync::{Arc, OnceLock};

/// What follows from the recording and the settings; shared by the copies of an estimator.
pub(crate) struct Design {
    pub history: History,
    pub settings: Settings,
    pub scaling: Scaling,
    pub weights: Weights,
    pub selection: Selection,
    pub x_bounds: Option<Bounds>,
    pub opening: OnceLock<Opening>, // once a run starts from an unknown state
    deepest: TrajectorySpace,       // of the horizon; others are computed where they are needed
    rest: Option<Equilibrium>,      // that is part of the data
    pub response: Option<OwnResponse>, // to known inputs
    pub driving: Option<Driving>,   // the disturbance that is fitted
    pub units: pulp::Arch,          // the machine's vector units
    pub ground: Arc<Ground>,        // what all depths share
    pub problems: Vec<Prepared>,    // of the depths that are kept, ascending, the last M
    place: Vec<usize>,              // in it, of the deepest that so many outputs fill
    pub spectral_radius: f64,
    pub warnings: Vec<String>,
    pub watch: Watch,
    pub input_watch: InputWatch,
    pub bound: Option<ErrorBound>, // as it starts
    pub centered: bool,
    pub evidence: Option<Calibration>, // what windows are measured by
    noise: Option<Vec<f64>>,           // stated beyond the recording's, where there is evidence
}

impl Design {
    /// As [`DdMhe::new`](crate::DdMhe::new), with the problems that these runs need.
    pub fn new(history: &History, config: &Config, needs: Needs) -> Result<Self, Error> {
        Design::by(history, config, needs, prepared(history, config)?)
    }

    /// With these scales and this rule.
    fn by(
        history: &History,
        config: &Config,
        needs: Needs,
        (scaling, rule): (Scaling, Defaults),
    ) -> Result<Self, Error> {
        if leaves_all_open(config) && recorded_default::leaves_open(config) {
            return match recorded_default::recorded(history, &scaling, &rule) {
                Ok(driving) => {
                    let why = "the recording is one of a linear system that noise drives, by its \
                        one-step residuals: white, straight and of the size that they predict";
                    let config = Config { weights: Weighting::Recorded, ..config.clone() };
                    let driving = Some(driving);
                    Design::with(history, &config, needs, (scaling, rule), (driving, why.into()))
                }
                Err(why) => {
                    let why = format!("not the weights of the recording: {why}");
                    Design::with(history, config, needs, (scaling, rule), (None, why))
                }
            };
        }
        let horizon = rule.horizon_for(config)?;
        let stated = (driving(history, &scaling, config, horizon)?, stated_weights(config).into());
        Design::with(history, config, needs, (scaling, rule), stated)
    }

    /// With this disturbance, and why.
    fn with(
        history: &History,
        config: &Config,
        needs: Needs,
        (scaling, rule): (Scaling, Defaults),
        (driving, why): (Option<Driving>, String),
    ) -> Result<Self, Error> {
        let horizon = rule.horizon_for(config)?;
        check_excitation(history, horizon)?;
        let weights = Weights::new(config, &rule, (&scaling, driving.as_ref()))?;
        check_weights(&weights, config, &scaling)?;
        let rest = config.rest().filter(|_| rule.noisy);
        let settled = driving.as_ref().filter(|driving| driving.stationary.is_some());
        let response = match settled {
            Some(driving) => OwnResponse::of_model(&driving.model, &scaling, horizon),
            None => OwnResponse::new(history, &scaling, horizon),
        };
        let scales = (&scaling, response.as_ref());
        let source = Source {
            stack: WindowStack::new(history, scales, horizon, rest).driven_by(driving.as_ref()),
            response: response.as_ref(),
            driving: driving.as_ref(),
            history,
            config,
            scaling: &scaling,
            weights: &weights,
            rest,
            noise: config.evidence.then(|| stated_beyond(config, &scaling)),
        };
        let deepest = source.deepest(&rule, horizon)?;
        let open = leaves_all_open(config) && rest.is_none() && driving.is_none();
        if open && let Some(other) = challenge(history, scales, &rule, deepest.space.lambda) {
            return Design::with(history, config, needs, other, (None, why));
        }
        source.design(needs, &rule, deepest, why)
    }

    /// Makes the problems of the growing windows of a run from an unknown state, unless they are
    /// there.
    pub fn open(&self) -> Result<(), Error> {
        if self.opening.get().is_some() {
            return Ok(());
        }
        let weights = opening_weights(&self.history, &self.scaling, &self.weights)?;
        let spaces = self.spaces(self.problems.iter().map(|problem| problem.layout().depth));
        let draft = |space: &TrajectorySpace| self.draft(space, &weights, None);
        let mut drafts = spaces.iter().map(draft).collect::<Result<Vec<_>, _>>()?;
        if let Some(mut evidence) = self.evidence.clone() {
            let setup = Setup { weights: &weights, ..self.setup() };
            evidence.open(&self.history, setup, self.settings.horizon)?;
            let scaling = &self.scaling;
            drafts.iter_mut().for_each(|draft| draft.measured_by((&evidence, true), scaling));
        }
        let problems = Draft::all_on(drafts, &self.ground);
        let _ = self.opening.set(Opening { problems, weights }); // a copy may have been faster
        Ok(())
    }

    /// Whether everything that these runs need is there.
    pub fn serves(&self, needs: Needs) -> bool {
        let all = !needs.opens || self.reaches(1) && self.opening.get().is_some();
        all && self.ground.sizes().start == needs.begin()
            && self.ground.sizes().filled
                == filled(&self.history, needs.start, self.settings.horizon)
    }

    /// What it takes in flight, as bytes.
    pub fn plan(&self, needs: Needs) -> Vec<u8> {
        let opening = self.opening.get().filter(|_| needs.opens && self.ground.sizes().opens());
        let opening = opening.map_or(&[][..], |opening| &opening.problems);
        self.ground.bytes(&self.problems, opening)
    }

    fn setup(&self) -> Setup<'_> {
        Setup {
            scaling: &self.scaling,
            weights: &self.weights,
            selection: &self.selection,
            driving: self.driving.as_ref(),
            rest: self.rest.as_ref().map(Equilibrium::as_rest),
            unknown: false,
        }
    }

    /// The spaces of some depths, as they were at construction.
    fn spaces(&self, depths: impl Iterator<Item = usize>) -> Vec<TrajectorySpace> {
        let rest = self.rest.as_ref().map(Equilibrium::as_rest);
        let scales = (&self.scaling, self.response.as_ref());
        let stack = WindowStack::new(&self.history, scales, self.settings.horizon, rest)
            .driven_by(self.driving.as_ref());
        depths.map(|depth| stack.space(depth, &self.selection)).collect()
    }

    fn draft(
        &self,
        space: &TrajectorySpace,
        weights: &Weights,
        measured: Option<&[bool]>,
    ) -> Result<Draft, Error> {
        let layout = Layout { depth: space.depth, ..self.problems[0].layout() };
        let bounds = (self.x_bounds.as_ref(), self.centered);
        let given = (measured, self.noise.as_deref());
        Draft::new(layout, space, &self.scaling, weights, bounds, given).map_err(factorisation)
    }

    /// The problem of the deepest window that so many outputs fill.
    #[inline(always)]
    pub fn problem(&self, outputs: usize) -> &Prepared {
        &self.problems[self.place[outputs]]
    }

    /// Where that is among the problems.
    pub fn place(&self, outputs: usize) -> usize {
        self.place[outputs]
    }

    /// Whether no window of a new run is shorter than this.
    pub fn reaches(&self, outputs: usize) -> bool {
        self.problems[0].layout().depth <= outputs
    }

    /// A full problem without the outputs that were not measured, factored anew.
    pub fn without_missing(
        &self,
        full: &Prepared,
        weights: &Weights,
        outputs: &[f64],
    ) -> Result<Prepared, Error> {
        let measured: Vec<bool> = outputs.iter().map(|v| v.is_finite()).collect();
        let depth = full.layout().depth;
        let other = (depth != self.deepest.depth).then(|| self.spaces([depth].into_iter()));
        let space = other.as_ref().and_then(|spaces| spaces.first()).unwrap_or(&self.deepest);
        Ok(self.draft(space, weights, Some(&measured))?.on(&self.ground))
    }
}

/// What the problems of all depths are made from.
struct Source<'a> {
    stack: WindowStack<'a>,
    history: &'a History,
    config: &'a Config,
    scaling: &'a Scaling,
    response: Option<&'a OwnResponse>,
    driving: Option<&'a Driving>,
    weights: &'a Weights,
    rest: Option<Rest<'a>>,
    noise: Option<Vec<f64>>, // stated beyond the recording's, where there is evidence
}

/// The problem of the horizon.
struct Deepest {
    space: TrajectorySpace,
    draft: Draft,
    selection: Selection,
    radius: f64,
}

impl Source<'_> {
    fn draft(
        &self,
        depth: usize,
        selection: &Selection,
    ) -> Result<(TrajectorySpace, Draft), Error> {
        let space = self.stack.space(depth, selection);
        let draft = self.draft_on(&space, self.weights)?;
        Ok((space, draft))
    }

    fn draft_on(&self, space: &TrajectorySpace, weights: &Weights) -> Result<Draft, Error> {
        let (n, p, driven) = (self.history.n(), self.history.p(), self.driving.is_some());
        let layout = Layout { n, p, depth: space.depth, driven };
        let bounds = (self.config.x_bounds.as_ref(), self.config.x_center == Center::History);
        let given = (None, self.noise.as_deref());
        Draft::new(layout, space, self.scaling, weights, bounds, given).map_err(factorisation)
    }

    /// Adds the problems of the growing windows of a run from an unknown state; their weights.
    fn opening<'s>(
        &self,
        spaces: impl Iterator<Item = &'s TrajectorySpace>,
        drafts: &mut Vec<Draft>,
    ) -> Result<Weights, Error> {
        let weights = opening_weights(self.history, self.scaling, self.weights)?;
        for space in spaces {
            drafts.push(self.draft_on(space, &weights)?);
        }
        Ok(weights)
    }

    /// With the rule's weight on ‖α‖² raised until errors do not grow.
    fn deepest(&self, rule: &Defaults, horizon: usize) -> Result<Deepest, Error> {
        let selection = select(&self.config.space, rule, self.weights, self.history.n());
        let lambda = self.stack.space(horizon, &selection).lambda;
        check_ridge(self.weights, self.config, lambda)?;
        guarded(self.config, selection, |selection| {
            let (space, draft) = self.draft(horizon, &selection)?;
            let radius = spectral_radius(&draft);
            Ok((radius, Deepest { space, draft, selection, radius }))
        })
    }

    fn settings(&self, space: &TrajectorySpace) -> Settings {
        let Source { config, scaling, weights, .. } = self;
        Settings {
            horizon: space.depth,
            rho: weights.rho,
            mu: match config.weighting() {
                Weighting::Scaled => weights.mu(),
                _ => weights.mu_as_printed(scaling),
            },
            weights: config.weighting(),
            process_noise: config.disturbance_to_fit().clone(),
            rank: space.undisturbed(),
            lambda: space.lambda,
            equilibrium_used: self.rest.is_some(),
            why: Vec::new(),
        }
    }

    /// What all depths share, where a window begins that holds so many outputs.
    fn ground(
        &self,
        needs: Needs,
        (horizon, rank): (usize, usize),
        (evidence, gate): (Option<&Calibration>, f64),
    ) -> Arc<Ground> {
        let Source { history, config, scaling, weights, driving, .. } = self;
        let filled = filled(history, needs.start, horizon);
        let sizes = Sizes {
            n: history.n(),
            p: history.p(),
            m: history.m(),
            lag: self.response.map_or(1, |response| response.sizes().lag),
            horizon,
            rank,
            filled,
            x_bounded: config.x_bounds.is_some(),
            v_bounded: config.v_bounds.is_some(),
            w_bounded: config.w_bounds.is_some(),
            driven: driving.is_some(),
            recorded: driving.is_some_and(|driving| driving.stationary.is_some()),
            rule: evidence.map(|evidence| evidence.rule).unwrap_or_default(),
            drifts: evidence.is_some() && config.drift.is_some(),
            centered: config.x_center == Center::History,
            plain_noise: config.certificate.is_none(),
            prices: config.soft.unwrap_or_default().prices(driving.is_some()),
            gate,
            stuck_missing: config.stuck == Stuck::Missing,
            start: needs.begin(),
        };
        let boxes = [&config.x_bounds, &config.v_bounds, &config.w_bounds].map(Option::as_ref);
        let x_prior = config.x_prior.as_deref();
        let first = first_window((history, scaling), needs.start, filled, x_prior);
        let scales = (*scaling, self.response);
        let own =
            evidence.map(|own| own.states.of_plan(own.rule, history, config, (scaling, *driving)));
        Arc::new(Ground::new(sizes, scales, (weights, *driving), boxes, (&first, own)))
    }

    /// With the problems of the shorter windows too.
    fn design(
        self,
        needs: Needs,
        rule: &Defaults,
        deepest: Deepest,
        weighed: String,
    ) -> Result<Design, Error> {
        let Source { history, config, .. } = self;
        let Deepest { space, draft, selection, radius } = deepest;
        let horizon = space.depth;
        let shorter = &depths(config, horizon, needs.filled(history, horizon))[1..];
        let (mut spaces, mut drafts) = (Vec::new(), Vec::new());
        // the largest first: the next ones find room where its temporary matrices were
        for depth in shorter {
            let (space, draft) = self.draft(*depth, &selection)?;
            drafts.push(draft);
            spaces.extend(needs.opens.then_some(space));
        }
        drafts.reverse();
        spaces.reverse();
        drafts.push(draft);
        let (count, rank) = (drafts.len(), drafts.iter().map(Draft::rank).max().unwrap_or(0));
        let opening = match needs.opens {
            true => Some(self.opening(spaces.iter().chain([&space]), &mut drafts)?),
            false => None,
        };
        let mut settings = self.settings(&space);
        settings.why = why(config, rule, (&settings, self.weights.mu()), selection, weighed);
        let evidence =
            self.evidence(&selection, horizon, (&mut drafts, count), opening.as_ref())?;
        let (gate, unused) = gate(config, evidence.as_ref())?;
        let ground = self.ground(needs, (horizon, rank), (evidence.as_ref(), gate));
        drop((spaces, self.stack));
        let mut problems = Draft::all_on(drafts, &ground);
        let growing = problems.split_off(count);
        let scales = (self.scaling, self.response);
        let Remarks { watch, input_watch, bound, mut warnings } =
            Remarks::new(history, config, scales, rule, (&settings, radius));
        warnings.extend(evidence.iter().flat_map(|own| evidence::words(own, self.scaling)));
        warnings.extend(unused);
        Ok(Design {
            history: history.clone(),
            x_bounds: config.x_bounds.clone(),
            units: pulp::Arch::new(),
            opening: opening
                .map(|weights| Opening { problems: growing, weights }.into())
                .unwrap_or_default(),
            rest: self.rest.map(Equilibrium::from),
            response: self.response.cloned(),
            driving: self.driving.cloned(),
            place: places(&problems, horizon),
            spectral_radius: radius,
            centered: config.x_center == Center::History,
            deepest: space,
            scaling: self.scaling.clone(),
            weights: self.weights.clone(),
            ground,
            settings,
            selection,
            problems,
            watch,
            input_watch,
            bound,
            warnings,
            evidence,
            noise: self.noise,
        })
    }

    /// What windows are measured by, into the drafts: `count` of them, and then those of an unknown
    /// start with their weights.
    fn evidence(
        &self,
        selection: &Selection,
        horizon: usize,
        (drafts, count): (&mut [Draft], usize),
        opening: Option<&Weights>,
    ) -> Result<Option<Calibration>, Error> {
        let Source { history, config, scaling, weights, driving, rest, .. } = self;
        let (history, config, scaling) = (*history, *config, *scaling);
        let (weights, driving, rest) = (*weights, *driving, *rest);
        let setup = Setup { scaling, weights, selection, driving, rest, unknown: false };
        let Some(mut evidence) = Calibration::new(history, config, setup, horizon)? else {
            return Ok(None);
        };
        if let Some(weights) = opening {
            evidence.open(history, Setup { weights, ..setup }, horizon)?;
        }
        for (number, draft) in drafts.iter_mut().enumerate() {
            draft.measured_by((&evidence, number >= count), scaling);
        }
        Ok(Some(evidence))
    }
}
