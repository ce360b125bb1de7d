import hashlib
import socket
import ssl
import threading
from pathlib import Path
from types import SimpleNamespace

import cv2
import pytest
import trustme

from tests.support.errors import refuses
from v3studio.pipelines.share import addresses
from v3studio.pipelines.share.addresses import qr_pixels, reachable_hosts
from v3studio.pipelines.share.certificates import Certificate, load_certificate, make_certificate

ADDRESS = "https://192.168.178.23:8000/prise%20%C3%A9/?t=3.2&view=30,10,2.5,0,0,0"


def test_every_interface_means_the_addresses_that_others_can_use(monkeypatch: pytest.MonkeyPatch) -> None:
    def at(*given: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(family=socket.AF_INET6 if ":" in address else socket.AF_INET, address=address)
            for address in given
        ]

    cards = {
        "lo": at("127.0.0.1", "::1"),
        "eth0": at("10.0.0.7", "fe80::1%eth0", "2001:db8::7"),
        "wlan0": at("192.168.1.5"),
        "off0": at("10.9.9.9"),
        "auto0": at("169.254.3.3"),
    }
    monkeypatch.setattr(addresses.psutil, "net_if_addrs", lambda: cards)
    stats = {name: SimpleNamespace(isup=name != "off0") for name in cards}
    monkeypatch.setattr(addresses.psutil, "net_if_stats", lambda: stats)
    monkeypatch.setattr(addresses, "route_address", lambda family: "192.168.1.5")
    assert reachable_hosts("0.0.0.0") == ["192.168.1.5", "10.0.0.7"], "the way out first"
    assert reachable_hosts("::") == ["[2001:db8::7]"]
    assert reachable_hosts("::1") == ["[::1]"]
    assert reachable_hosts("studio.example") == ["studio.example"]
    cards.clear()
    assert reachable_hosts("0.0.0.0") == [socket.gethostname()]


@pytest.mark.parametrize("size", [1, 300])
def test_a_code_says_the_address(size: int) -> None:
    image = qr_pixels(ADDRESS, size)
    assert image.shape[0] == image.shape[1]
    assert size == 1 or image.shape[0] <= size < 1.5 * image.shape[0]
    if size == 1:  # one pixel a module: too small for readers
        image = cv2.resize(image, None, fx=6, fy=6, interpolation=cv2.INTER_NEAREST)
    assert cv2.QRCodeDetector().detectAndDecode(image)[0] == ADDRESS


def presented(certificate: Certificate, name: str, trusted: ssl.SSLContext) -> bytes:
    """The certificate that a client gets, in DER."""
    with socket.create_server(("127.0.0.1", 0)) as sock:

        def answer() -> None:
            with sock.accept()[0] as plain, certificate.context.wrap_socket(plain, server_side=True) as secure:
                secure.recv(1)

        thread = threading.Thread(target=answer)
        thread.start()
        place = sock.getsockname()
        with socket.create_connection(place) as plain, trusted.wrap_socket(plain, server_hostname=name) as secure:
            secure.sendall(b"x")
            shown = secure.getpeercert(binary_form=True)
        thread.join(120)
    assert shown is not None
    return shown


def test_a_certificate_is_made_and_its_fingerprint_told() -> None:
    made = make_certificate(["127.0.0.1", "[::1]", "studio"])
    trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
    digest = hashlib.sha256(presented(made, "studio", trusting)).hexdigest()
    assert made.fingerprint.replace(":", "").lower() == digest
    assert made.made
    assert make_certificate(["studio"]).fingerprint != made.fingerprint


def test_given_certificates_are_used(tmp_path: Path) -> None:
    authority = trustme.CA()
    leaf = authority.issue_cert("studio.example")
    both, chain, key = tmp_path / "both.pem", tmp_path / "chain.pem", tmp_path / "key.pem"
    leaf.private_key_and_cert_chain_pem.write_to_path(both)
    chain.write_bytes(b"".join(blob.bytes() for blob in leaf.cert_chain_pems))
    leaf.private_key_pem.write_to_path(key)
    checking = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    authority.configure_trust(checking)
    for certificate in (load_certificate(both, None), load_certificate(chain, key)):
        der = presented(certificate, "studio.example", checking)
        assert certificate.fingerprint.replace(":", "").lower() == hashlib.sha256(der).hexdigest()
        assert not certificate.made


def test_what_is_no_certificate_is_refused(tmp_path: Path) -> None:
    leaf, other = trustme.CA().issue_cert("a.example"), trustme.CA().issue_cert("b.example")
    chain, key, text = tmp_path / "chain.pem", tmp_path / "key.pem", tmp_path / "text.pem"
    leaf.cert_chain_pems[0].write_to_path(chain)
    other.private_key_pem.write_to_path(key)
    text.write_text("hello")
    for pair in ((chain, None), (chain, key), (text, key), (tmp_path / "none.pem", None), (chain, tmp_path / "none")):
        with refuses("serve.bad_certificate", file=pair[0]):
            load_certificate(*pair)
