//! Where bytes come from, as a person writes it.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

use crate::AddressError;

const BAUD_USUAL: u32 = 115_200;

/// Where frames come from as bytes.
///
/// ```
/// use kinds_driver_shim::wire::Address;
///
/// let address: Address = "serial:///dev/ttyACM0?baud=921600".parse().unwrap();
/// assert_eq!(address, Address::Serial { path: "/dev/ttyACM0".into(), baud: 921_600 });
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Datagrams that come to this address of ours.
    Udp(SocketAddr),
    /// Standard input.
    Stdin,
    /// A serial line.
    Serial {
        /// Its device file.
        path: PathBuf,
        /// Bits a second.
        baud: u32,
    },
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let address = match text.split_once("://") {
            None if text == "stdin" => Some(Self::Stdin),
            Some(("udp", address)) => address.parse().ok().map(Self::Udp),
            Some(("serial", line)) => serial(line),
            _ => None,
        };
        address.ok_or_else(|| AddressError { text: text.to_owned() })
    }
}

fn serial(line: &str) -> Option<Address> {
    let (path, baud) = match line.split_once("?baud=") {
        Some((path, baud)) => (path, baud.parse().ok().filter(|baud| *baud > 0)?),
        None => (line, BAUD_USUAL),
    };
    (path.starts_with('/') && !path.contains('?')).then(|| Address::Serial { path: path.into(), baud })
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(f, "udp://{address}"),
            Self::Stdin => f.write_str("stdin"),
            Self::Serial { path, baud } => write!(f, "serial://{}?baud={baud}", path.display()),
        }
    }
}
