//! Why settings that were left open are what they are: a sentence each, by the rule of
//! [`defaults`](crate::defaults).

use crate::certificate::Certificate;
use crate::config::{Config, ProcessNoise, Settings, Weighting};
use crate::defaults::Defaults;
use crate::scaling::EXACT;
use crate::space::{Selection, Space};

/// For each setting that was left open, (name, why); with μ in scaled units and the selection of
/// the horizon's windows.
pub(crate) fn why(
    config: &Config,
    rule: &Defaults,
    (settings, mu): (&Settings, f64),
    selection: Selection,
    weights: String,
) -> Vec<(&'static str, String)> {
    let raised = selection != rule.selection(mu);
    let own = Open { config, rule, settings, raised };
    let mut all = vec![("weights", weights)];
    all.extend(config.horizon.is_none().then(|| ("horizon", own.horizon())));
    all.extend(config.rho.is_none().then(|| ("rho", own.rho())));
    all.extend(config.mu.is_none().then(|| ("mu", own.mu())));
    all.extend((config.space == Space::Auto).then(|| ("space", own.space())));
    let open = config.process_noise == ProcessNoise::Auto;
    all.extend(open.then(|| ("process_noise", own.process_noise())));
    all
}

/// Why the weights are what they are where the recording's were not asked for.
pub(crate) fn stated_weights(config: &Config) -> &'static str {
    let by_certificate = config.certificate.is_some();
    match config.weights {
        Weighting::Auto if by_certificate => "a certificate is in the units of the log",
        Weighting::Auto if config.weighting() == Weighting::Paper => {
            "a stated rho or mu is meant as (17) is printed"
        }
        Weighting::Auto => {
            "in scales of the channels, since settings beside them are stated; the recording's own \
             weights are looked at where none is"
        }
        _ => "as stated",
    }
}

struct Open<'a> {
    config: &'a Config,
    rule: &'a Defaults,
    settings: &'a Settings,
    raised: bool, // the weight on ‖a‖², above the rule's
}

impl Open<'_> {
    fn recorded(&self) -> bool {
        self.settings.weights == Weighting::Recorded
    }

    fn horizon(&self) -> String {
        let M = self.settings.horizon;
        let needed = self.config.certificate.as_ref().map(Certificate::minimum_horizon);
        if needed == Some(M) {
            return "the smallest M with 4 eta^M < 1 for the certificate's eta".into();
        }
        if self.recorded() && M < self.rule.horizon {
            return format!(
                "{M} do, since the prior of the recording's weights holds all that was before the \
                 window"
            );
        }
        if self.rule.challenged {
            return format!(
                "windows of {M} outputs estimate held-out parts of the recording clearly better \
                 than those of the rule"
            );
        }
        let Defaults { horizon, wanted, complete, hidden, .. } = *self.rule;
        if horizon < wanted {
            return format!(
                "the longest of which the recording has enough windows, below {wanted}"
            );
        }
        format!(
            "from {complete}, where one step of an affine model explains the recording, to \
             {hidden}, where it explains nothing; it leaves {} of the variance",
            self.misfit()
        )
    }

    fn rho(&self) -> String {
        match () {
            () if self.config.certificate.is_some() => "the certificate's eta".into(),
            () if self.recorded() => "the disturbance makes older outputs count less".into(),
            () => "the rule's; anything from 0.9 to 0.97 does as well".into(),
        }
    }

    fn mu(&self) -> String {
        match self.settings.weights {
            _ if self.config.certificate.is_some() => {
                "mean weight of an output in the certificate's R".into()
            }
            Weighting::Recorded => {
                "mean inverse variance of the outputs' noise in the recording".into()
            }
            _ if self.rule.challenged => "from the outputs' own noise, held against the error of \
                a prior on held-out parts of the recording"
                .into(),
            Weighting::Scaled => "the rule's, in scales of the channels".into(),
            Weighting::Auto | Weighting::Paper => {
                format!("the rule's {} (scale of the states / scale of the outputs)²", self.rule.mu)
            }
        }
    }

    fn process_noise(&self) -> String {
        match self.recorded() {
            true => "goes with the weights of the recording".into(),
            false => "none beside other weights than the recording's".into(),
        }
    }

    fn space(&self) -> String {
        let lambda = self.settings.lambda;
        let raised = if self.raised { ", raised until estimation errors do not grow" } else { "" };
        match () {
            () if self.recorded() => "the windows of the recording's linear model".into(),
            () if lambda == 0.0 => "all directions of the recorded windows, exactly: one step of \
                an affine model leaves rounding"
                .into(),
            () if self.rule.challenged => format!(
                "all directions of the recorded windows, with the weight {lambda:.3} of a ridge \
                 that held-out parts of the recording chose{raised}"
            ),
            () => format!(
                "all directions of the recorded windows, with the weight {lambda:.3e} against \
                 those that noise has filled, in proportion to the {} of the variance that one \
                 step of an affine model leaves{raised}",
                self.misfit()
            ),
        }
    }

    /// What the affine model leaves, in words.
    fn misfit(&self) -> String {
        let share = 100.0 * self.rule.misfit;
        match self.rule.misfit {
            f if f < EXACT => "nothing but rounding".into(),
            f if f < 1e-4 => format!("{share:.0e} %"),
            _ => format!("{share:.2} %"),
        }
    }
}
