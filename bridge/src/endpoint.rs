//! Where the ends of a bridge meet.

use std::fmt;
use std::str::FromStr;

/// An address and a port, such as `tcp/0.0.0.0:7447` to listen at, or `tcp/crunch.local:7447` to connect to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// A name, an IPv4 address, or an IPv6 address in brackets.
    host: String,
    port: u16,
}

impl Endpoint {
    /// Host and port, as the system's resolver takes them.
    pub(crate) fn address(&self) -> (&str, u16) {
        (self.host.trim_start_matches('[').trim_end_matches(']'), self.port)
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "tcp/{}:{}", self.host, self.port)
    }
}

impl FromStr for Endpoint {
    type Err = EndpointError;

    fn from_str(text: &str) -> Result<Self, EndpointError> {
        let error = || EndpointError { text: text.to_owned() };
        let (host, port) =
            text.strip_prefix("tcp/").and_then(|rest| rest.rsplit_once(':')).ok_or_else(error)?;
        let port = port.parse().ok().filter(|port| *port != 0).ok_or_else(error)?;
        let is_bracketed = host.starts_with('[') && host.ends_with(']');
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
        let is_host = match is_bracketed {
            true => host[1..host.len() - 1].parse::<std::net::Ipv6Addr>().is_ok(),
            false => !host.is_empty() && host.chars().all(allowed),
        };
        if is_host { Ok(Self { host: host.to_owned(), port }) } else { Err(error()) }
    }
}

/// Why a text is no endpoint.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{text}\" is no place for the ends of a bridge to meet; write tcp/ADDRESS:PORT, such as tcp/0.0.0.0:7447 to listen at or \
     tcp/crunch.local:7447 to connect to"
)]
pub struct EndpointError {
    /// The text as given.
    text: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoints_are_kept_as_written_and_are_addresses_to_the_system() {
        for (text, address) in [
            ("tcp/0.0.0.0:7447", ("0.0.0.0", 7447)),
            ("tcp/[::]:1", ("::", 1)),
            ("tcp/crunch-2.local:65535", ("crunch-2.local", 65535)),
        ] {
            let endpoint: Endpoint = text.parse().unwrap();
            assert_eq!((endpoint.to_string().as_str(), endpoint.address()), (text, address));
        }
    }

    #[test]
    fn others_are_refused_in_words() {
        for text in [
            "",
            "robot:7447",
            "udp/robot:7447",
            "tcp/robot",
            "tcp/robot:",
            "tcp/:7447",
            "tcp/robot:0",
            "tcp/robot:65536",
            "tcp/::1:7447",
            "tcp/[robot]:7447",
            "tcp/robot:7447#iface=eth0",
            "tcp/ro bot:7447",
        ] {
            assert_eq!(
                text.parse::<Endpoint>().unwrap_err().to_string(),
                format!(
                    "\"{text}\" is no place for the ends of a bridge to meet; write tcp/ADDRESS:PORT, such as tcp/0.0.0.0:7447 to \
                     listen at or tcp/crunch.local:7447 to connect to"
                )
            );
        }
    }
}
