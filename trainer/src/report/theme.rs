//! Colours and letters, for light and for dark.
//!
//! Style sheets name colours as custom properties only. A page defines the properties, so that its figures follow when
//! it turns dark. A figure in a file of its own has the values written into its rules instead: programs that draw SVG
//! but know no custom properties then show it too.

/// A colour of the page.
struct Property {
    name: &'static str,
    light: &'static str,
    dark: &'static str,
}

const fn property(name: &'static str, light: &'static str, dark: &'static str) -> Property {
    Property { name, light, dark }
}

/// Colours that kinds are told apart by.
pub(super) const N_COLOURS: usize = 8;

/// The kinds' colours are the eight of Okabe & Ito 2008, *Color universal design*, which people of every colour vision
/// tell apart. On white, the light ones among them are darkened until a line has the contrast of 3 : 1 that WCAG 2.2
/// (1.4.11) asks of graphics, keeping their hue, and spread in lightness so that simulated red- and green-blindness
/// leaves the nearest two about as far apart as the original's; on dark, black and blue had to give way.
const PROPERTIES: [Property; 15] = [
    property("paper", "#ffffff", "#15181c"),
    property("ink", "#1b1f24", "#e4e7eb"),
    property("quiet", "#5b6470", "#a3adb8"),
    property("rule", "#d5dae0", "#3a424b"),
    property("grid", "#e9ecf0", "#272d34"),
    property("farther", "#0072b2", "#56b4e9"),
    property("nearer", "#a44700", "#e69f00"),
    property("kind-0", "#000000", "#f4f4f4"),
    property("kind-1", "#a47104", "#e69f00"),
    property("kind-2", "#3a9bce", "#56b4e9"),
    property("kind-3", "#0e9d73", "#009e73"),
    property("kind-4", "#9f9502", "#f0e442"),
    property("kind-5", "#0072b2", "#3f7fd8"),
    property("kind-6", "#a44700", "#d55e00"),
    property("kind-7", "#c976a4", "#cc79a7"),
];

/// Where the dark colours hold. Paper is white, so never in print.
const DARK: &str = "@media screen and (prefers-color-scheme:dark)";

const PAGE: &str = include_str!("page.css");
const FIGURE: &str = include_str!("figure.css");

/// The style sheet of a page with figures in it.
pub(super) fn of_page() -> String {
    let define = |colour: fn(&Property) -> &str| -> String {
        PROPERTIES.iter().map(|property| format!("--{}:{};", property.name, colour(property))).collect()
    };
    let (light, dark) = (define(|property| property.light), define(|property| property.dark));
    format!(":root{{color-scheme:light dark;{light}}}\n{DARK}{{:root{{{dark}}}}}\n{PAGE}{FIGURE}")
}

/// The style sheet of a figure in a file of its own.
pub(super) fn of_figure() -> String {
    let (light, dark) =
        (resolved(FIGURE, |property| property.light), resolved(FIGURE, |property| property.dark));
    format!("{light}{DARK}{{\n{dark}}}\n")
}

fn resolved(sheet: &str, colour: fn(&Property) -> &str) -> String {
    PROPERTIES.iter().fold(sheet.to_string(), |sheet, property| {
        sheet.replace(&format!("var(--{})", property.name), colour(property))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance, as WCAG 2.2 defines it.
    fn luminance(colour: &str) -> f64 {
        let channel = |start: usize| {
            let value = f64::from(u8::from_str_radix(&colour[start..start + 2], 16).unwrap()) / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    }

    fn contrast(a: &str, b: &str) -> f64 {
        let (a, b) = (luminance(a), luminance(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn text_has_a_contrast_of_4_5_and_lines_of_3_to_the_paper_in_light_and_dark() {
        let paper = &PROPERTIES[0];
        for property in &PROPERTIES {
            let least = match property.name {
                "paper" | "rule" | "grid" => continue,
                "ink" | "quiet" => 4.5,
                _ => 3.0,
            };
            for (scheme, colour, paper) in
                [("light", property.light, paper.light), ("dark", property.dark, paper.dark)]
            {
                let found = contrast(colour, paper);
                assert!(found >= least, "{} in {scheme}: {found:.2}", property.name);
            }
        }
    }

    #[test]
    fn every_colour_that_a_rule_names_is_defined_and_resolved() {
        for property in &PROPERTIES {
            let name = format!("var(--{})", property.name);
            assert!(PAGE.contains(&name) || FIGURE.contains(&name), "nobody uses {}", property.name);
        }
        assert!(!of_figure().contains("var("), "{}", of_figure());
        let defined = of_page();
        for after in (PAGE.to_string() + FIGURE).split("var(--").skip(1) {
            let name = after.split(')').next().unwrap();
            assert!(defined.contains(&format!("--{name}:")), "{name} has no value");
        }
    }
}
