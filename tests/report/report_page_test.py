# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""The page of `accessvdb report` in a real browser, held against points.ply and report.json.

    report_page_test.py ACCESSVDB ACCESSVDB_LAB CHROMIUM      exit code 77 (skipped) without Chromium or NumPy
"""

import base64
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import unittest

try:
    import numpy as np

    import stored_field
except ImportError as error:
    print(f"skipped: {error}; apt install python3-numpy")
    sys.exit(77)
from browser import Browser

PROGRAM, LAB_PROGRAM, CHROMIUM = "", "", ""


def run(*arguments, program=None):
    return subprocess.run([program or PROGRAM, *map(str, arguments)], capture_output=True, text=True, check=False)


def box_mesh(path, low, high):
    """A closed box as binary STL."""
    corners = np.array([[(high if n >> axis & 1 else low)[axis] for axis in range(3)] for n in range(8)])
    faces = [(0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6),
             (0, 6, 2), (1, 3, 7), (1, 7, 5)]
    with open(path, "wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(faces)))
        for face in faces:
            file.write(struct.pack("<3f", 0, 0, 0) + corners[list(face)].astype("<f4").tobytes() + bytes(2))


class ReportPage(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = Browser(CHROMIUM, (1000, 560))  # small: software draws it
        cls.folder = tempfile.TemporaryDirectory(prefix="accessvdb_report_")
        cls.root = pathlib.Path(cls.folder.name)

    @classmethod
    def tearDownClass(cls):
        cls.browser.__exit__()
        cls.folder.cleanup()

    def make(self, folder, *options):
        """The page of a folder; None of its making may fail."""
        html = self.root / f"{folder.name}.html"
        result = run("report", "--map", folder, "--out", html, *options)
        self.assertEqual(result.returncode, 0, result.stderr)
        return html

    def show(self, html, fragment=""):
        """Opens a page and waits for its points. It must say nothing and ask for nothing."""
        self.browser.open(f"file://{html}{fragment}")
        self.browser.wait_for("document.documentElement.dataset.state")
        self.assertEqual(self.browser.evaluate("document.documentElement.dataset.state"), "ready",
                         self.browser.evaluate("document.getElementById('message').textContent"))
        self.assert_silent()
        return int(self.browser.evaluate("document.documentElement.dataset.drawn"))

    def assert_silent(self):
        self.assertEqual(self.browser.messages, [])
        others = [each for each in self.browser.requests if not each.startswith("file:")]
        self.assertEqual(others, [], "no network")
        self.assertEqual(len(self.browser.requests), 1, "the page is one file")

    def facts(self):
        return json.loads(self.browser.evaluate("document.getElementById('facts').textContent"))

    def click_at(self, html, position, fragment="", distance=0.6):
        """Looks straight at a place from above, so that it is in the middle of the picture, and clicks there."""
        place = ",".join(f"{value:.5f}" for value in position)
        self.show(html, f"#view={place},{distance},-90,89.9{fragment}")
        x, y = self.browser.evaluate(
            "(() => { const b = document.getElementById('view').getBoundingClientRect();"
            " return [b.left + b.width / 2, b.top + b.height / 2]; })()")
        self.browser.click(x, y)
        self.browser.wait_for("!document.getElementById('card').hidden")
        return self.browser.evaluate(
            "(() => { const c = document.getElementById('card'); return {...c.dataset, text: c.innerText}; })()")

    def test_points_say_how_likely_the_tool_reaches_them(self):
        points = stored_field.random_points(2000, seed=4)
        probability = np.round(np.random.default_rng(5).uniform(0, 1, len(points)), 3).astype("<f4")
        probability[points["label"] == 0] = -1
        chosen = [int(np.flatnonzero(points["label"] == label)[0]) for label in (1, 2, 0)]
        points["position"][chosen, 2] = 5  # above all others
        of_two = (["a", "b"], 0, np.where(points["label"] == 1, 1, 0))
        for name, tools in (("likely", None), ("likely_of_two", of_two)):
            html = self.make(stored_field.write_field(self.root / name, points, tools=tools, probability=probability))
            for index in chosen:
                text = self.click_at(html, points["position"][index])["text"].replace("\u202f", " ")
                self.assertEqual("Probability" in text, probability[index] >= 0, text)
                if probability[index] >= 0:  # rounded to half a percent
                    said = float(re.search(r"Probability\s+([0-9.]+) %", text).group(1))
                    self.assertAlmostEqual(said, 100 * float(probability[index]), delta=0.2501)
            self.assertFalse(self.browser.evaluate("document.querySelector('[data-mode=probability]').hidden"))
            self.browser.evaluate("document.querySelector('[data-mode=probability]').click()")
            self.assertIn("100", self.browser.evaluate("document.getElementById('legend').textContent"))
        # Fields of before have neither.
        html = self.make(stored_field.write_field(self.root / "of_before", points))
        self.assertNotIn("Probability", self.click_at(html, points["position"][chosen[0]])["text"])
        self.assertTrue(self.browser.evaluate("document.querySelector('[data-mode=probability]').hidden"))

    def test_a_table_has_a_row_for_each_tree(self):
        points = stored_field.random_points(3000)
        # Trees side by side along x, and some points of none.
        tree = np.floor(points["position"][:, 0]).astype(int) * 10 + 1
        tree[::50] = -2147483648
        folder = stored_field.write_field(self.root / "trees", points, carried={"tree_id": tree})
        html = self.make(folder)
        self.show(html)
        rows = lambda: self.browser.evaluate(
            "[...document.querySelectorAll('#tables tbody tr')].map((r) => [...r.cells].map((c) => c.textContent))")
        self.assertEqual([row[0] for row in rows()], ["1", "11", "21", "31", "none"])
        counts = {str(n): f"{(tree == n).sum()}" for n in (1, 11, 21, 31)}
        for row in rows()[:4]:
            self.assertEqual(row[1].replace("\u202f", "").replace(",", ""), counts[row[0]])
        self.browser.evaluate("document.querySelectorAll('#tables thead button')[1].click()")
        by_points = sorted(counts, key=lambda n: -int(counts[n]))
        self.assertEqual([row[0] for row in rows()][:4], by_points)
        self.browser.evaluate("document.querySelectorAll('#tables thead button')[0].click()")
        before = self.browser.evaluate("location.hash")
        self.browser.evaluate("document.querySelectorAll('#tables tbody tr')[2].click()")
        self.browser.wait_for(f"location.hash !== {json.dumps(before)}")
        # The camera looks at the middle of the tree's box.
        view = [float(each) for each in re.search(r"view=([^&]*)", self.browser.evaluate("location.hash"))[1].split(",")]
        own = points["position"][tree == 21]
        for axis in range(3):
            self.assertAlmostEqual(view[axis], (own[:, axis].min() + own[:, axis].max()) / 2, delta=0.01)
        self.assertEqual(self.browser.evaluate(
            "document.querySelectorAll('#tables tbody tr')[2].getAttribute('aria-selected')"), "true")
        self.assert_silent()

    def picture(self):
        """Pixels of the picture that print would show, as rows of red, green, blue."""
        data = self.browser.evaluate("""(async () => {
            window.dispatchEvent(new Event('beforeprint'));
            const picture = document.getElementById('print-picture');
            await picture.decode();
            window.dispatchEvent(new Event('afterprint'));
            const canvas = document.createElement('canvas'), {naturalWidth: w, naturalHeight: h} = picture;
            [canvas.width, canvas.height] = [w, h];
            const context = canvas.getContext('2d');
            context.drawImage(picture, 0, 0);
            const {data} = context.getImageData(0, 0, w, h);
            let text = '';
            for (let n = 0; n < data.length; n += 4) text += String.fromCharCode(data[n], data[n + 1], data[n + 2]);
            return [w, h, btoa(text)];
        })()""")
        return np.frombuffer(base64.b64decode(data[2]), np.uint8).reshape(data[1], data[0], 3)

    def test_a_plot_with_trees_is_in_the_picture_and_its_table_in_the_column(self):
        # A wide ground and a thin tall tree, which has one point in a hundred.
        points = stored_field.random_points(20_000, size_m=1.0)
        points["position"][:, :2] *= 24
        points["position"][:, 2] *= 0.1
        tree = np.zeros(len(points), int)
        tree[:200] = 123456
        points["position"][:200] = np.column_stack([np.full(200, 12.0), np.full(200, 8.0), np.linspace(0, 20, 200)])
        points["label"], points["reason"], points["score"] = 1, 0, 0
        points["label"][200:], points["reason"][200:] = 2, 2
        folder = stored_field.write_field(self.root / "plot", points, carried={"classification": tree})
        self.show(self.make(folder))
        view = "Object.fromEntries([...document.querySelectorAll('#view')].map((c) => ['size', [c.clientWidth, c.clientHeight]]))"
        width, height = self.browser.evaluate(view)["size"]
        self.browser.wait_for("location.hash.includes('view=')")
        x, y, z, distance, azimuth, elevation = (
            float(each) for each in re.search(r"view=([^&]*)", self.browser.evaluate("location.hash"))[1].split(","))
        a, e = np.radians([azimuth, elevation])
        back = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0])
        from_eye = points["position"] - (np.array([x, y, z]) + distance * back)
        depth = from_eye @ -back
        up = np.tan(np.radians(20))  # half of the field of view
        inside = (np.abs(from_eye @ right) <= depth * up * width / height) & \
                 (np.abs(from_eye @ np.cross(back, right)) <= depth * up)
        self.assertGreater(inside.mean(), 0.99)  # a far return may be outside
        self.assertGreater(inside[:200].mean(), 0.95, "the top of the tree")
        self.assertLessEqual(*self.browser.evaluate(
            "(() => { const r = document.querySelector('#tables .rows'); return [r.scrollWidth, r.clientWidth]; })()"))

        # A click on the tree's row leaves it as it is, and all else fades.
        colourful = lambda: (np.ptp(self.picture().astype(int), axis=2) > 75).sum()
        before = colourful()
        self.browser.evaluate("[...document.querySelectorAll('#tables tbody tr')].find((r) => r.cells[0].textContent === '123456').click()")
        pixels = self.picture().astype(int)
        green = (pixels[:, :, 1] - pixels[:, :, 0] > 60).sum()
        pink = (pixels[:, :, 0] - pixels[:, :, 1] > 60).sum()
        self.assertGreater(green, 200)
        self.assertLess(pink, green, "the ground has paled")
        self.browser.evaluate("document.getElementById('fit').click()")
        self.assertGreater(colourful(), 0.9 * before)

    def test_several_tools_are_shown_one_by_one(self):
        points = stored_field.random_points(4000)
        names = ["arm", "pencil", "boom"]
        random = np.random.default_rng(5)
        accessible = points["label"] == 1
        stands_for = random.integers(0, 3, len(points))
        reached = np.where(accessible, random.integers(0, 8, len(points)) | 1 << stands_for, 0)
        tree = np.floor(points["position"][:, 0]).astype(int)
        chosen = np.flatnonzero(accessible & (stands_for == 0) & (reached == 3))[0]  # arm and pencil, the arm's way in
        points["position"][chosen, 2] = 5
        run_tools = [{"name": name, "tool": f"builtin:{'pruner' if name == 'arm' else 'pencil'}"} for name in names]
        run_tools[2]["tool"] = "boom.stl"
        folder = stored_field.write_field(self.root / "tools", points, carried={"tree_id": tree},
                                          tools=(names, stands_for, reached), report={"tools": run_tools})
        html = self.make(folder)
        self.assertEqual(self.show(html), 4000)
        self.assertEqual([bool(each["drawn"]) for each in self.facts()["tools"]], [True, True, False])
        text = lambda query: self.browser.evaluate(f"document.querySelector('{query}').textContent").replace("\u202f", "")
        rows = lambda: self.browser.evaluate(
            "[...document.querySelectorAll('#tables tbody tr')].map((r) => [...r.cells].map((c) => c.textContent))")
        table = [line.split(",") for line in run("query", "--map", folder, "--table", "--quiet").stdout.splitlines()]
        self.assertEqual(table[0][-3:], [f"accessible_{name}_m2" for name in names])

        def expect(name):
            own = accessible if name is None else (reached >> names.index(name) & 1) == 1
            # Shares have one decimal.
            self.assertAlmostEqual(float(re.match(r"[\d.]+", text("#headline"))[0]), 100 * own.mean(), delta=0.051)
            # Those with a row of their own, in colour and in the list.
            counted = self.browser.evaluate("Object.fromEntries([...document.querySelectorAll('.chip')].map((c) =>"
                                            " [c.dataset.reason, c.querySelector('.count').textContent.split(' · ')[0]]))")
            counted = {reason: int(n.replace("\u202f", "")) for reason, n in counted.items()}
            self.assertEqual(counted["none"], own.sum())
            self.assertEqual(counted.get("other", 0), (accessible & ~own).sum())
            self.assertEqual(counted["tool"], (points["reason"] == 6).sum())
            self.assertEqual(sum(counted.values()), 4000)
            column = table[0].index(f"accessible_{name}_m2" if name else "accessible_m2")
            for line in rows():
                csv = next(each for each in table if each[:2] == ["tree_id", line[0]])
                share = 100 * float(csv[column]) / float(csv[3])
                self.assertAlmostEqual(float(line[3].split("\u202f")[0]), share, delta=0.051)

        expect(None)
        shares = {text(f"#tool-choice option:nth-child({n})").split(": ")[0] for n in (1, 2, 3, 4)}
        self.assertEqual(shares, {"any of them", *names})
        picked = "(k) => { const c = document.getElementById('tool-choice'); c.value = k; c.dispatchEvent(new Event('change')); }"
        self.browser.evaluate("document.querySelectorAll('#tables thead button')[1].click()")
        order = [row[0] for row in rows()]
        for k, name in enumerate(names):
            self.browser.evaluate(f"({picked})({k})")
            expect(name)
            self.browser.wait_for(f"location.hash.includes('tool={name}')")
            self.assertEqual([row[0] for row in rows()], order, "still sorted by the same column")
        self.browser.evaluate(f"({picked})(-1)")
        expect(None)
        self.assert_silent()

        # In place: the tool that stands for the point, for any tool and for itself.
        for name, words in ((None, "builtin:pruner in place"), ("arm", "builtin:pruner in place"),
                            ("pencil", "pencil reaches the point, too"), ("boom", "Choose arm, pencil above")):
            card = self.click_at(html, points["position"][chosen], f"&tool={name}" if name else "")
            self.assertEqual(int(card["id"]), chosen)
            self.assertIn(words, card["text"])
            self.assertIn("arm, pencil", card["text"])
            self.assertEqual("By another tool only" in card["text"], name == "boom")
        # A link with a point of another tool's, or a tool that is none.
        self.show(html, "#tool=nothing")
        expect(None)

        # Too many points: those that differ in their tools alone are all there.
        thinned = self.root / "tools_thinned.html"
        self.assertEqual(run("report", "--map", folder, "--out", thinned, "--max-points", 2000).returncode, 0)
        drawn = self.show(thinned)
        cells = np.column_stack([np.floor(points["position"] / self.facts()["points"]["cell_m"]).astype(int),
                                 points["reason"], reached])
        self.assertEqual(drawn, len(np.unique(cells, axis=0)))

    def test_tools_are_those_of_the_map(self):
        points = stored_field.random_points(100)
        points["label"], points["reason"] = 2, 6
        one = stored_field.write_field(self.root / "of_one", points)
        two = stored_field.write_field(self.root / "of_two", points, tools=(["a", "b"], 0, 0),
                                       report={"tools": [{"name": "a", "tool": "a.stl"}, {"name": "b", "tool": "b.stl"}]})
        for folder, tools, code in ((one, ["builtin:pencil"] * 2, 2), (two, ["builtin:pencil"], 2),
                                    (two, ["builtin:pencil", "-"], 0), (two, ["builtin:pencil"] * 2, 0), (two, [], 0)):
            flags = [flag for tool in tools for flag in ("--tool", tool)]
            result = run("report", "--map", folder, "--out", self.root / "tools_given.html", *flags)
            self.assertEqual(result.returncode, code, result.stderr)
            if code == 2:
                self.assertIn("error[usage.tool]", result.stderr)
        (two / "report.json").unlink()  # which would say that there are two
        result = run("report", "--map", two, "--out", self.root / "tools_given.html", "--tool", "builtin:pencil")
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(self.show(self.make(two)), 100)

    def test_title_client_and_site(self):
        folder = stored_field.write_field(self.root / "for_client", stored_field.random_points(1000))
        text = lambda name: self.browser.evaluate(f"document.getElementById('{name}').textContent")
        self.show(self.make(folder))
        self.assertEqual(text("title"), "for_client")
        self.assertTrue(self.browser.evaluate("document.getElementById('client').hidden"))
        self.show(self.make(folder, "--title", "Oaks </script><b>1", "--client", "City", "--site", "Lane & Hill"))
        self.assertEqual(text("title"), "Oaks </script><b>1")  # as text, whatever it holds
        self.assertEqual(text("client"), "City · Lane & Hill")
        self.assertEqual(self.browser.evaluate("document.title"), "Oaks </script><b>1 – accessibility report")
        self.assert_silent()

    def test_of_many_trees_the_page_has_the_largest(self):
        points = stored_field.random_points(30000)
        folder = stored_field.write_field(self.root / "many", points, carried={"tree_id": np.arange(30000) // 2})
        self.show(self.make(folder))
        self.assertEqual(len(self.facts()["tables"][0]["rows"]), 1000)
        self.assertEqual(self.facts()["tables"][0]["rows_total"], 15000)
        self.assertIn("14", self.browser.evaluate("document.getElementById('tables').textContent"))
        table = run("query", "--map", folder, "--table", "--quiet")
        self.assertEqual(len(table.stdout.splitlines()), 1 + 1 + 15000)

    def test_a_map_is_drawn_as_it_was_counted(self):
        scans, out = self.root / "scans", self.root / "mapped"
        simulated = run("simulate", "--scene", "torus", "--frames", 12, "--range-noise", 0, "--out", scans,
                        program=LAB_PROGRAM)
        self.assertEqual(simulated.returncode, 0, simulated.stderr)
        mapped = run("map", "--device", "cpu", "--scans", scans / "scans", "--poses", scans / "poses.txt", "--tool",
                     "builtin:pencil", "--voxel", 0.01, "--origin", "0,0,0", "--out", out, "--html")
        self.assertEqual(mapped.returncode, 0, mapped.stderr)
        counts = stored_field.read_report(out)["counts"]
        self.assertGreater(counts["surface_points"], 300)
        drawn = self.show(out / "report.html")
        self.assertEqual(drawn, counts["surface_points"])
        found = {}
        for each in self.facts()["classes"]:
            found[each["reason"]] = found.get(each["reason"], 0) + each["points"]
        self.assertEqual(found.pop("none", 0), counts["accessible"])
        self.assertEqual(found, {reason: n for reason, n in counts["reasons"].items() if n > 0})
        # The same page by hand: the tool of the run needs no file.
        again = self.root / "again.html"
        self.assertEqual(run("report", "--map", out, "--out", again).returncode, 0)
        self.assertEqual(again.read_bytes(), (out / "report.html").read_bytes())

        # A page that no longer belongs to the files beside it is named.
        mapped = run("map", "--device", "cpu", "--scans", scans / "scans", "--poses", scans / "poses.txt", "--tool",
                     "builtin:pencil", "--voxel", 0.05, "--allow-hidden-tool", "--out", out)
        self.assertIn("warning[output.old_report]", mapped.stderr)

        tiled = self.root / "tiled"
        mapped = run("map", "--device", "cpu", "--scans", scans / "scans", "--poses", scans / "poses.txt", "--tool",
                     "builtin:pencil", "--voxel", 0.01, "--origin", "0,0,0", "--out", tiled, "--html", "--tiles", 1.28)
        self.assertEqual(mapped.returncode, 0, mapped.stderr)
        self.assertEqual(self.show(tiled / "report.html"), counts["surface_points"])
        tiles = sorted((tiled / "tiles").iterdir())
        self.assertGreater(len(tiles), 1)
        points = stored_field.read_points(tiles[-1])
        highest = int(points["position"][:, 2].argmax())
        card = self.click_at(tiled / "report.html", points["position"][highest])
        self.assertEqual((card["tile"], int(card["id"])), (tiles[-1].name, highest))

    def test_a_click_gives_the_point_under_it(self):
        points = stored_field.random_points(70_000)  # more than a block
        chosen = [3, 40_000, 69_999]
        points["position"][chosen, 2] = 5  # above all others
        html = self.make(stored_field.write_field(self.root / "clicked", points))
        for index in chosen:
            card = self.click_at(html, points["position"][index])
            self.assertEqual(int(card["id"]), index)
            at = re.search(r"Position\s+(\S+)\s+(\S+)\s+(\S+)", card["text"].replace("\u202f", " ")).groups()
            # Drawn positions are rounded to an eighth of a voxel, texts to a millimetre.
            np.testing.assert_allclose([float(value) for value in at], points["position"][index],
                                       atol=0.05 / 16 + 0.0005)
            self.assertIn(f"yaw {points['yaw'][index]:.1f}°", card["text"])
            self.assertIn(str(points["score"][index]), card["text"])
            self.assertIn(f"{points['confidence'][index]:.2f}"[:3], card["text"])
        # Points of a hidden reason cannot be clicked.
        reason = stored_field.REASONS[points["reason"][3]]
        card = self.click_at(html, points["position"][3], f"&hide={reason}")
        self.assertNotEqual(int(card["id"]), 3)

    def test_the_address_holds_view_colour_reasons_and_point(self):
        html = self.make(stored_field.write_field(self.root / "address", stored_field.random_points(500)))
        fragment = "#view=1.5000,2.0000,0.5000,3.2500,30.00,20.00&colour=height&hide=arm,tool&point=17"
        self.show(html, fragment)
        self.browser.wait_for(f"location.hash === '{fragment}'")
        self.assertEqual(self.browser.evaluate("document.getElementById('card').dataset.id"), "17")
        self.browser.evaluate("document.querySelector('.chip[data-reason=arm]').click()")
        self.browser.wait_for("location.hash.includes('hide=tool&')")

    def test_names_are_text(self):
        hostile = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\u2028&amp;\""
        report = {"parameters": {"tool": hostile, "scans": hostile}, "notices": [hostile],
                  "warnings": [{"id": hostile, "text": hostile}], "inputs": [{"path": hostile, "sha256": "0" * 64}],
                  "version": hostile, "device": hostile}
        points = stored_field.random_points(10)
        folder = stored_field.write_field(self.root / "<script>alert(3)<script>", points,
                                          comments=["tool </script><script>alert(4)</script>"], report=report)
        html = self.root / "hostile.html"
        result = run("report", "--map", folder, "--out", html)
        self.assertEqual(result.returncode, 0, result.stderr)
        text = html.read_text()
        self.assertEqual(text.count("</script>"), 3, "one block of points, the facts, the script")
        self.assertNotIn("\u2028", text)
        self.assertEqual(self.show(html), 10)
        self.assertEqual(self.browser.evaluate("document.getElementById('title').textContent"), folder.name)
        self.assertIn(hostile, self.browser.evaluate("document.getElementById('problems').textContent"))
        self.assertEqual(self.browser.evaluate("document.querySelectorAll('script').length"), 2)

    def test_a_changed_script_does_not_run(self):
        html = self.make(stored_field.write_field(self.root / "policy", stored_field.random_points(10)))
        text = html.read_text()
        policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text).group(1)
        self.assertIn("default-src 'none'", policy)
        self.assertNotIn("unsafe", policy)
        broken = self.root / "broken.html"
        broken.write_text(text.replace('"use strict";', '"use strict"; ', 1))
        self.browser.open(f"file://{broken}")
        self.assertIsNone(self.browser.evaluate("document.documentElement.dataset.state || null"))
        self.assertTrue(any("Content Security Policy" in each for each in self.browser.messages), self.browser.messages)

    def test_a_field_without_points(self):
        folder = stored_field.write_field(self.root / "empty", stored_field.random_points(0))
        result = run("report", "--map", folder, "--out", self.root / "empty.html")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("field.empty", result.stderr)
        self.assertEqual(self.show(self.root / "empty.html"), 0)
        self.browser.click(900, 400)
        self.assertTrue(self.browser.evaluate("document.getElementById('card').hidden"))

    def test_too_many_points_are_thinned_and_counted(self):
        points = stored_field.random_points(200_000)
        folder = stored_field.write_field(self.root / "thinned", points)
        html = self.make(folder, "--max-points", 20_000)
        drawn = self.show(html)
        facts = self.facts()
        cell_m = facts["points"]["cell_m"]
        self.assertLessEqual(drawn, 20_000)
        self.assertGreater(drawn, 8_000, "not many fewer than allowed")
        self.assertEqual(facts["points"]["total"], 200_000)
        cells = np.column_stack([np.floor(points["position"] / cell_m).astype(int), points["reason"]])
        _, first = np.unique(cells, axis=0, return_index=True)
        self.assertEqual(drawn, len(first), "one for each cell and reason")
        self.assertEqual(sum(each["points"] for each in facts["classes"]), 200_000)
        self.assertIn("left out", self.browser.evaluate("document.getElementById('drawn').textContent"))
        # Ids are those of points.ply: the first point of a cell is the one that is drawn.
        highest = max(first, key=lambda index: points["position"][index, 2])
        card = self.click_at(html, points["position"][highest])
        self.assertEqual(int(card["id"]), highest)

    def test_points_inside_the_placed_tool(self):
        voxel = 0.1
        points = stored_field.random_points(20_000, size_m=3.0)
        target = points["position"][0] = np.array([1.5, 1.5, 3.5])
        points["direction"][0], points["yaw"][0] = [0, 1, 0], 90
        folder = stored_field.write_field(self.root / "tool", points, voxel, comments=["self_exclusion_voxels 3"])
        mesh = self.root / "box.stl"
        low, high = np.array([0.0, -0.33, -1.98]), np.array([0.97, 0.42, 0.12])
        box_mesh(mesh, low, high)
        html = self.make(folder, "--tool", mesh, "--tool-unit", "m")
        card = self.click_at(html, target)
        self.assertEqual(int(card["id"]), 0)
        # Into the tool's frame, x along +y of the world; cells that the box touches, without the ball around the tip.
        step = voxel / 8
        drawn = np.round(points["position"] / step) * step
        offset = drawn - np.round(target / step) * step
        cells = np.round(np.column_stack([offset[:, 1], -offset[:, 0], offset[:, 2]]) / voxel)
        touched = np.all((cells >= np.ceil(low / voxel - 0.5)) & (cells <= np.floor(high / voxel + 0.5)), axis=1)
        inside = touched & ((cells**2).sum(axis=1) > 3**2)
        self.assertGreater(inside.sum(), 100)
        # Floats in the page may put a point that lies on the edge of a cell into the next one.
        self.assertAlmostEqual(int(card["inside"]), int(inside.sum()), delta=0.01 * inside.sum())
        self.assertIn("does not say which tool", card["text"])

    def field_with_targets(self, name):
        """A field, its tool as a mesh, and three targets above all other points, whose tools tilt and roll."""
        points = stored_field.random_points(20_000, size_m=3.0)
        random = np.random.default_rng(7)
        quaternions = random.normal(size=(6, 4))
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        # By a right angle, points on the edges of cells would go by the last bits of numpy's cosines.
        level = [[np.cos(a / 2), 0, 0, np.sin(a / 2)] for a in np.radians([10, 100, 200])]
        points["position"][:3] = [[0.7, 1.5, 3.2], [1.5, 1.5, 1.5], [2.2, 0.9, 2.0]]
        points["label"][:3], points["reason"][:3], points["score"][:3] = 1, 0, 0
        folder = stored_field.write_field(self.root / name, points, 0.1, comments=["tool x/tool.stl", "self_exclusion_voxels 3"])
        rows = [(0, level), (1, quaternions[:3]), (2, quaternions[3:4])]
        targets = [stored_field.target_at(row, points["position"][row], turns) for row, turns in rows]
        mesh = self.root / f"{name}.stl"
        box_mesh(mesh, [0.0, -0.33, -1.18], [0.97, 0.42, 0.12])  # the same from no two sides
        return points, folder, targets, mesh

    def card(self):
        return self.browser.evaluate(
            "(() => { const c = document.getElementById('card'); return {...c.dataset, text: c.innerText}; })()")

    def test_the_tool_stands_in_each_pose_of_an_approach(self):
        points, folder, targets, mesh = self.field_with_targets("approached")
        approaches = stored_field.write_approaches(self.root / "approaches", targets)
        html = self.make(folder, "--approaches", approaches, "--tool", mesh, "--tool-unit", "m")
        step, voxel, low, high = 0.1 / 8, 0.1, np.array([0.0, -0.33, -1.18]), np.array([0.97, 0.42, 0.12])
        drawn = np.round(points["position"] / step) * step
        most = 0
        for number, target in enumerate(targets):
            for way, approach in enumerate(target["approaches"]):
                for pose in ("pre_contact", "contact", "retreat"):
                    if way == 0 and pose == "pre_contact":
                        self.show(html, f"#target={number}&approach=0&pose=pre_contact")
                    elif pose == "pre_contact":
                        self.browser.evaluate("document.querySelector('#card [title=\"Next approach\"]').click()")
                    self.browser.evaluate(f"document.querySelector('#card [data-pose={pose}]').click()")
                    wanted = f"target={number}&approach={way}&pose={pose}"
                    self.browser.wait_for(f"location.hash.endsWith('{wanted}')")
                    q = approach[pose]["orientation_wxyz"]
                    back = [q[0], -q[1], -q[2], -q[3]]
                    offset = stored_field.turned(back, drawn - np.array(approach[pose]["position"]))
                    cells = np.round(offset / voxel)
                    touched = np.all((cells >= np.ceil(low / voxel - 0.5)) & (cells <= np.floor(high / voxel + 0.5)), axis=1)
                    inside = (touched & ((cells**2).sum(axis=1) > 3**2)).sum()
                    most = max(most, inside)
                    card = self.card()
                    # Floats in the page may put a point that lies on the edge of a cell into the next one.
                    self.assertAlmostEqual(int(card["inside"]), int(inside), delta=0.02 * inside + 2, msg=wanted)
                    self.assertIn(f"Target {number}", card["text"])
                    self.assertIn(f"Approach {way}", card["text"])
                    self.assertIn(target["why"], card["text"])
        self.assertGreater(most, 200)
        # There is no next one after the last, and a way back.
        self.show(html, "#target=0&approach=2&pose=contact")
        self.assertTrue(self.browser.evaluate("document.querySelector('#card [title=\"Next approach\"]').disabled"))
        self.browser.evaluate("document.querySelector('#card [title=\"Previous approach\"]').click()")
        self.browser.wait_for("location.hash.includes('target=0&approach=1&pose=contact')")
        self.assert_silent()

    def test_a_click_goes_to_a_target(self):
        points, folder, targets, mesh = self.field_with_targets("targets")
        targets[1]["why"] = "</script><b>best</b>"
        approaches = stored_field.write_approaches(self.root / "approaches_listed", targets)
        html = self.make(folder, "--approaches", approaches / "approaches.json", "--tool", mesh, "--tool-unit", "m")
        self.show(html)
        listed = self.browser.evaluate(
            "[...document.querySelectorAll('#targets .target')].map((b) => [...b.children].map((c) => c.textContent))")
        self.assertEqual([row[:2] for row in listed], [[str(n), each["why"]] for n, each in enumerate(targets)])
        self.assertIn("3 approaches", listed[0][2])
        self.assertIn("one approach", listed[2][2])

        def expect_at(number):
            self.browser.wait_for(f"location.hash.includes('target={number}&approach=0&pose=contact')")
            view = re.search(r"view=([^&]*)", self.browser.evaluate("location.hash"))[1].split(",")
            np.testing.assert_allclose([float(each) for each in view[:3]], targets[number]["position"], atol=1e-3)
            current = self.browser.evaluate("[...document.querySelectorAll('[aria-current=true]')].map((b) => b.textContent)")
            self.assertEqual(len(current), 2, "in the list and in the picture")
            self.assertTrue(all(each.startswith(str(number)) for each in current), current)
            ring = self.browser.evaluate(
                "(() => { const r = document.getElementById('ring').getBoundingClientRect(), v = document.getElementById('view')"
                ".getBoundingClientRect(); return [r.left + r.width / 2 - v.left - v.width / 2, r.top + r.height / 2 - v.height / 2]; })()")
            np.testing.assert_allclose(ring, [0, 0], atol=1.5)

        for number in (2, 0, 1):
            self.browser.evaluate(f"document.querySelectorAll('#targets .target')[{number}].click()")
            expect_at(number)
        self.browser.evaluate("document.getElementById('fit').click()")
        self.browser.evaluate("document.querySelectorAll('.pin')[2].click()")
        expect_at(2)
        self.browser.evaluate("document.querySelector('#card .close').click()")
        self.browser.wait_for("!location.hash.includes('target=')")
        self.assertEqual(self.browser.evaluate("document.querySelectorAll('[aria-current=true]').length"), 0)
        # A point that is a target says so.
        card = self.click_at(html, points["position"][0])
        self.assertEqual(int(card["id"]), 0)
        self.browser.evaluate("document.querySelector('#card .go').click()")
        expect_at(0)
        # What is no target is none.
        for fragment in ("#target=3", "#target=-1", "#target=x&approach=1"):
            self.show(html, fragment)
            self.assertTrue(self.browser.evaluate("document.getElementById('card').hidden"))
        self.show(html, "#target=1&approach=77&pose=none")
        self.browser.wait_for("location.hash.includes('target=1&approach=0&pose=contact')")
        self.assert_silent()

    def test_numbers_in_the_picture_do_not_hide_each_other(self):
        points = stored_field.random_points(2000)
        points["label"], points["reason"], points["score"] = 1, 0, 0
        folder = stored_field.write_field(self.root / "crowded", points)
        targets = [stored_field.target_at(row, points["position"][row], [[1, 0, 0, 0]]) for row in range(300)]
        self.show(self.make(folder, "--approaches", stored_field.write_approaches(self.root / "crowd", targets)))
        pins = np.array(self.browser.evaluate(
            "[...document.querySelectorAll('.pin')].filter((p) => !p.hidden).map((p) => { const r = p.getBoundingClientRect();"
            " return [Number(p.textContent), r.left, r.right, r.top, r.bottom]; })"))
        self.assertEqual(pins[0, 0], 0, "the best one is seen")
        self.assertGreater(len(pins), 30)
        self.assertLess(pins[:, 0].max(), 200)
        self.assertGreater(pins[:, 0].max(), 99)
        for n, (_, left, right, top, bottom) in enumerate(pins):
            apart = (pins[:, 1] >= right) | (pins[:, 2] <= left) | (pins[:, 3] >= bottom) | (pins[:, 4] <= top)
            self.assertEqual(np.flatnonzero(~apart).tolist(), [n])

    def test_an_arrow_for_each_approach(self):
        points, folder, targets, _ = self.field_with_targets("arrows")
        approaches = stored_field.write_approaches(self.root / "approaches_drawn", targets)
        html = self.make(folder, "--approaches", approaches)
        at, distance = np.array(targets[0]["position"]), 2.0
        self.show(html, f"#view={at[0]},{at[1]},{at[2]},{distance},-90,89.9")
        pixels = self.picture().astype(int)
        height, width, _ = pixels.shape
        px_per_m = height / 2 / np.tan(np.radians(20)) / distance

        def darkest_along(approach):
            """Across the arrow, at places of its shaft: the darkest sum of red, green, blue, and how colourful that is."""
            tip, tail = (np.array(approach[pose]["position"]) for pose in ("contact", "pre_contact"))
            found = []
            for share in (0.4, 0.5, 0.6):
                x, y = ((tip + share * (tail - tip) - at) * px_per_m)[:2]
                around = pixels[int(height / 2 - y) - 2:int(height / 2 - y) + 3, int(width / 2 + x) - 2:int(width / 2 + x) + 3].reshape(-1, 3)
                grey = around[np.ptp(around, axis=1) < 30]  # points are colourful
                self.assertGreater(len(grey), 4, "an arrow is here")
                found.append(grey.sum(axis=1).min() / 3)
            return np.mean(found)

        first, *others = [darkest_along(each) for each in targets[0]["approaches"]]
        self.assertLess(first, 60)
        for other in others:
            self.assertGreater(other, first + 60, "the first is darker than the others")
        # Of a chosen approach the arrow is another colour.
        self.show(html, f"#view={at[0]},{at[1]},{at[2]},{distance},-90,89.9&target=0&approach=1")
        pixels = self.picture().astype(int)
        x, y = (0.5 * (np.array(targets[0]["approaches"][1]["pre_contact"]["position"]) - at) * px_per_m)[:2]
        red, green, blue = pixels[int(height / 2 - y), int(width / 2 + x)]
        self.assertGreater(red, green + 40)
        self.assertGreater(green, blue)

    def test_approaches_of_a_map(self):
        scans, out, state = self.root / "approached_scans", self.root / "approached_map", self.root / "approached_state"
        run("simulate", "--scene", "torus", "--frames", 12, "--range-noise", 0, "--out", scans, program=LAB_PROGRAM)
        given = ["--device", "cpu", "--scans", scans / "scans", "--poses", scans / "poses.txt", "--tool", "builtin:pencil",
                 "--voxel", 0.01, "--origin", "0,0,0"]
        mapped = run("map", *given, "--checkpoint", state, "--out", out)
        self.assertEqual(mapped.returncode, 0, mapped.stderr)
        approaches = self.root / "approached_list"
        found = run("approaches", "--map", state, "--tool", "builtin:pencil", "--allow-unknown", "--most", 5, "--spacing", 0.05,
                    "--out", approaches)
        self.assertEqual(found.returncode, 0, found.stderr)
        html = self.make(out, "--approaches", approaches)
        self.assertNotIn("approaches.", run("report", "--map", out, "--approaches", approaches, "--out", html).stderr)
        again = self.root / "approached_again.html"
        self.assertEqual(run("report", "--map", out, "--approaches", approaches, "--out", again).returncode, 0)
        self.assertEqual(again.read_bytes(), html.read_bytes())
        targets = json.loads((approaches / "approaches.json").read_text())["targets"]
        self.assertEqual(len(targets), 5)
        self.show(html, "#target=4")
        card = self.card()
        self.assertEqual(int(card["id"]), targets[4]["point"])
        self.assertIn("builtin:pencil in place", card["text"])
        # In a map in tiles a point is one of its tile.
        tiled = self.root / "approached_tiles"
        mapped = run("map", *given, "--tiles", 1.28, "--out", tiled)
        self.assertEqual(mapped.returncode, 0, mapped.stderr)
        name = None
        for tile in sorted((tiled / "tiles").iterdir()):
            points = stored_field.read_points(tile)
            same = np.flatnonzero((points["position"] == targets[0]["position"]).all(axis=1))
            if len(same) == 1:
                name, targets[0]["point"] = tile.name, int(same[0])
        self.assertIsNotNone(name)
        self.show(self.make(tiled, "--approaches", stored_field.write_approaches(self.root / "approached_tile", targets[:1])),
                  "#target=0")
        self.assertEqual(self.card()["tile"], name)

    def test_targets_that_the_map_says_something_else_about(self):
        points, folder, targets, mesh = self.field_with_targets("odd")
        points["label"][1], points["reason"][1] = 2, 6
        stored_field.write_field(folder, points, 0.1, comments=["tool x/tool.stl"])
        targets[0]["tool"] = "another"
        result = run("report", "--map", folder, "--approaches", stored_field.write_approaches(self.root / "odd_list", targets),
                     "--tool", mesh, "--tool-unit", "m", "--out", self.root / "odd.html")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("warning[approaches.labels] 1 of 3 targets", result.stderr)
        self.assertIn("warning[approaches.tool]", result.stderr)
        self.show(self.root / "odd.html", "#target=0")
        self.assertIn("no tool of the name another", self.card()["text"])
        self.assertIn("1 of 3 targets", self.browser.evaluate("document.getElementById('problems').textContent"))

    def test_views_are_listed_and_drawn(self):
        points, folder, targets, _ = self.field_with_targets("viewed")
        # Upright at first; then turned a quarter to the left, lying in front of all points.
        views = [stored_field.view_at([-2, 1.5, 1.5], [1, 0, 0, 0], travel_m=0, way_is_free=False),
                 stored_field.view_at([1.5, -2, 3.7], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], resolves=99, way_is_free=False),
                 stored_field.view_at([1.5, 5.0, 3.7], [1, 0, 0, 0], resolves=55)]
        listed_in = stored_field.write_views(self.root / "views_listed", views, points)
        html = self.make(folder, "--views", listed_in)
        self.assertNotIn("views.", run("report", "--map", folder, "--views", listed_in / "views.json", "--out", html).stderr)
        self.show(html)
        rows = self.browser.evaluate(
            "[...document.querySelectorAll('#views .target')].map((b) => [...b.children].map((c) => c.textContent))")
        self.assertEqual([row[0] for row in rows], ["0", "1", "2"])
        self.assertEqual([row[1] for row in rows], [f"resolves about {n} points" for n in ("1\u202f235", "99", "55")])
        for words in ("1\u202f001 seen too rarely", "200 from the wrong side", "34 with unknown space before them"):
            self.assertIn(words, rows[0][2])
        self.assertIn("2.5\u202fm of way, not known to be free", rows[1][2])
        self.assertIn("2.5\u202fm of way, known to be free", rows[2][2])
        self.assertIn("no start", rows[0][2])
        unresolved = sum(int((points["reason"] == n).sum()) for n in (1, 3, 4))
        self.assertIn(f"{unresolved:,}".replace(",", "\u202f"),
                      self.browser.evaluate("document.getElementById('views-summary').textContent"))

        def expect_at(number):
            self.browser.wait_for(f"location.hash.includes('view=') && location.hash.endsWith('next={number}')")
            view = re.search(r"view=([^&]*)", self.browser.evaluate("location.hash"))[1].split(",")
            np.testing.assert_allclose([float(each) for each in view[:3]], views[number]["pose"]["position"], atol=1e-3)
            current = self.browser.evaluate("[...document.querySelectorAll('[aria-current=true]')].map((b) => b.textContent[0])")
            self.assertEqual(current, [str(number)] * 2, "in the list and in the picture")

        for number in (2, 0, 1):
            self.browser.evaluate(f"document.querySelectorAll('#views .target')[{number}].click()")
            expect_at(number)
        self.browser.evaluate("document.getElementById('fit').click()")
        self.browser.evaluate("document.querySelectorAll('.pin')[2].click()")
        expect_at(2)
        self.show(html, "#next=1")
        expect_at(1)
        for fragment in ("#next=3", "#next=x"):
            self.show(html, fragment)
            self.assertEqual(self.browser.evaluate("document.querySelectorAll('[aria-current=true]').length"), 0)

        def beside(number, aside, chosen=""):
            """The colour next to a tip, as seen from above; its pyramid opens that way or not."""
            at = views[number]["pose"]["position"]
            self.show(html, f"#view={at[0]},{at[1]},{at[2]},1,-90,89.9{chosen}")
            pixels = self.picture().astype(int)
            height, width, _ = pixels.shape
            x, y = np.array(aside) * height / 2 / np.tan(np.radians(20))
            return pixels[int(height / 2 - y), int(width / 2 + x)]

        red, green, blue = beside(0, (0.04, 0))
        self.assertGreater(green, red + 40, "the first is green")
        self.assertGreater(green, blue + 10)
        background = beside(0, (-0.04, 0))
        for _, aside in ((0, (0, 0.06)), (0, (0, -0.06))):
            np.testing.assert_allclose(beside(0, aside), background, atol=3)
        turned = beside(1, (0, 0.04))
        self.assertLess(np.ptp(turned), 20, "others are grey")
        self.assertLess(turned.sum(), background.sum() - 150)
        np.testing.assert_allclose(beside(1, (0.06, 0)), background, atol=3)
        red, green, blue = beside(1, (0, 0.04), "&next=1")
        self.assertGreater(red, green + 40, "the chosen one is orange")
        self.assertGreater(green, blue)
        # Beside approaches.
        both = self.make(folder, "--views", listed_in, "--approaches", stored_field.write_approaches(self.root / "both", targets))
        self.show(both, "#next=2")
        self.assertEqual(self.browser.evaluate("document.querySelectorAll('.pin').length"), 6)
        self.browser.evaluate("document.querySelectorAll('#targets .target')[1].click()")
        self.browser.wait_for("location.hash.includes('target=1') && !location.hash.includes('next=')")
        self.assert_silent()

    def test_views_of_another_map_are_said_to_be(self):
        points = stored_field.random_points(50)
        folder = stored_field.write_field(self.root / "not_viewed", points)
        points["reason"][np.flatnonzero(points["reason"] == 3)[0]] = 5
        views = stored_field.write_views(self.root / "views_elsewhere", [stored_field.view_at([0, 0, 0], [1, 0, 0, 0])], points)
        result = run("report", "--map", folder, "--views", views, "--out", self.root / "elsewhere.html")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("warning[views.counts]", result.stderr)

    def test_folders_of_older_versions(self):
        points = stored_field.random_points(50)
        folder = stored_field.write_field(self.root / "older", points)
        (folder / "report.json").write_text(json.dumps({"schema": 1, "counts": {"surface_points": 50}, "new": {"a": [1]}}))
        self.assertEqual(self.show(self.make(folder)), 50)
        (folder / "report.json").unlink()
        self.assertEqual(self.show(self.make(folder)), 50)

    def test_contradictions_are_said(self):
        folder = stored_field.write_field(self.root / "other", stored_field.random_points(50),
                                          report={"counts": {"surface_points": 51}},
                                          comments=["tool_sha256 " + "0" * 64])
        result = run("report", "--map", folder, "--out", self.root / "other.html", "--tool", "builtin:pencil")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("report.counts", result.stderr)
        self.assertIn("report.tool", result.stderr)
        self.show(self.root / "other.html")
        self.assertIn("51", self.browser.evaluate("document.getElementById('problems').textContent"))


class ReportErrors(unittest.TestCase):
    def assert_refused(self, result, code, error, words, out):
        """One error, and no page."""
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertEqual(result.stderr.count("error["), 1)
        self.assertIn(f"error[{error}]", result.stderr)
        self.assertIn(words, result.stderr)
        self.assertFalse(out.exists())

    def test_each_ends_with_its_code_and_leaves_nothing(self):
        with tempfile.TemporaryDirectory() as name:
            root = pathlib.Path(name)
            whole = stored_field.write_field(root / "whole", stored_field.random_points(20))
            damaged = stored_field.write_field(root / "damaged", stored_field.random_points(20))
            (damaged / "report.json").write_text("{")
            cut = stored_field.write_field(root / "cut", stored_field.random_points(20))
            (cut / "points.ply").write_bytes((cut / "points.ply").read_bytes()[:-1])
            out = root / "x.html"
            for code, error, arguments in [
                    (2, "usage.missing", ["--out", out]),
                    (2, "usage.missing", ["--map", whole]),
                    (2, "usage.option", ["--map", whole, "--out", out, "--views", ""]),
                    (2, "usage.option", ["--map", whole, "--out", out, "--approaches", ""]),
                    (2, "usage.max_points", ["--map", whole, "--out", out, "--max-points", 10]),
                    (3, "input.no_field", ["--map", root / "none", "--out", out]),
                    (3, "input.missing", ["--map", root, "--out", out]),
                    (3, "input.report", ["--map", damaged, "--out", out]),
                    (3, "input.truncated", ["--map", cut, "--out", out]),
                    (7, "output.", ["--map", whole, "--out", root / "no" / "x.html"]),
            ]:
                result = run("report", *arguments)
                self.assertEqual(result.returncode, code, result.stderr)
                self.assertIn(f"error[{error}", result.stderr)
                self.assertFalse(out.exists())

    def test_approaches_that_are_none_or_of_another_map(self):
        with tempfile.TemporaryDirectory() as name:
            root = pathlib.Path(name)
            points = stored_field.random_points(20)
            whole = stored_field.write_field(root / "whole", points)
            out, good = root / "x.html", [[1, 0, 0, 0], [0, 0, 0, 1]]

            def refused(code, error, words, path=None, row=3, **changes):
                if path is None:
                    target = stored_field.target_at(row, points["position"][min(row, 19)], changes.pop("turns", good),
                                                    changes.pop("stand_off_m", 0.4)) | changes
                    path = stored_field.write_approaches(root / "list", [stored_field.target_at(0, points["position"][0], good), target])
                result = run("report", "--map", whole, "--approaches", path, "--out", out)
                self.assert_refused(result, code, error, words, out)

            def written(text):
                (root / "text.json").write_text(text)
                return root / "text.json"

            refused(3, "input.missing", "accessvdb approaches", path=root / "none")
            refused(3, "input.missing", "approaches.json", path=whole)
            refused(3, "input.approaches", "is not valid JSON", path=written("{"))
            refused(3, "input.approaches", "is not valid JSON", path=whole / "points.ply")
            for text in ("{}", "[]", "7", '{"accessible_points": 1, "covered_points": 1}'):
                refused(3, "input.approaches", "has no ", path=written(text))
            refused(3, "input.approaches", "has no accessible_points", path=whole / "report.json")
            nan = float("nan")
            refused(3, "input.approaches", "is not valid JSON", confidence=nan)
            refused(3, "input.approaches", "no finite number at targets[1].confidence", confidence=None)
            refused(3, "input.approaches", "out of range at targets[1].confidence", confidence=1.5)
            refused(3, "input.approaches", "no finite number at targets[1].position[2]", position=[0, 0, None])
            refused(3, "input.approaches", "3 numbers at targets[1].position", position=[0, 0])
            refused(3, "input.approaches", "no count at targets[1].point", point=-1)
            refused(3, "input.approaches", "no text at targets[1].why", why=3)
            refused(3, "input.approaches", "no list at targets[1].approaches", approaches=None)
            refused(3, "input.approaches", "without a way in: targets[1]", approaches=[])
            refused(3, "input.approaches", "no unit quaternion at targets[1].approaches[1].pre_contact",
                    turns=[[1, 0, 0, 0], [1, 0, 0.1, 0]])
            refused(3, "input.approaches", "not at its target: targets[1].approaches[0].contact",
                    approaches=stored_field.target_at(3, points["position"][3] + 0.01, good)["approaches"])
            refused(3, "input.approaches", "not at its target: targets[1].approaches[0].pre_contact", stand_off_m=1e30)
            refused(4, "approaches.other_map", "the map has no such point", row=20)
            refused(4, "approaches.other_map", "target 1 is point 4", point=4)
            other = points["position"][3] + [0.001, 0, 0]
            moved = stored_field.target_at(3, other, good)
            refused(4, "approaches.other_map", "which the map has at",
                    position=moved["position"], approaches=moved["approaches"])
            # What is read is not written over.
            result = run("report", "--map", whole, "--approaches", root / "list", "--out", root / "list" / "approaches.json")
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertIn("output.is_input", result.stderr)

    def test_views_that_are_none(self):
        with tempfile.TemporaryDirectory() as name:
            root = pathlib.Path(name)
            whole = stored_field.write_field(root / "whole", stored_field.random_points(20))
            out = root / "x.html"

            def refused(error, words, path=None, position=(1, 2, 3), turn=(1, 0, 0, 0), without=None, **changes):
                if path is None:
                    view = stored_field.view_at(position, turn, **changes)
                    view.pop(without, None)
                    path = stored_field.write_views(root / "list", [stored_field.view_at([0, 0, 0], [1, 0, 0, 0]), view])
                result = run("report", "--map", whole, "--views", path, "--out", out)
                self.assert_refused(result, 3, error, words, out)

            def written(text):
                (root / "text.json").write_text(text)
                return root / "text.json"

            refused("input.missing", "accessvdb views", path=root / "none")
            refused("input.missing", "views.json", path=whole)
            refused("input.views", "is not valid JSON", path=written("{"))
            refused("input.views", "has no unresolved_points", path=written("[]"))
            refused("input.views", "has no unresolved_points.unseen", path=written('{"unresolved_points": {"confidence": 1}}'))
            refused("input.views", "has no views",
                    path=written('{"unresolved_points": {"confidence": 1, "unseen": 1, "unknown": 1}}'))
            for key in ("pose", "resolves", "of_confidence", "of_unseen", "of_unknown", "travel_m", "way_is_free"):
                refused("input.views", f"has no views[1].{key}", without=key)
            refused("input.views", "is not valid JSON", travel_m=float("nan"))
            refused("input.views", "no finite number at views[1].resolves", resolves=None)
            refused("input.views", "out of range at views[1].travel_m", travel_m=-1)
            refused("input.views", "no true or false at views[1].way_is_free", way_is_free=1)
            refused("input.views", "3 numbers at views[1].pose.position", position=(1, 2))
            refused("input.views", "out of range at views[1].pose.position[2]", position=(1, 2, 1e30))
            refused("input.views", "no unit quaternion at views[1].pose", turn=(1, 0, 0.1, 0))
            # What is read is not written over.
            stored_field.write_views(root / "list", [])
            result = run("report", "--map", whole, "--views", root / "list", "--out", root / "list" / "views.json")
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertIn("output.is_input", result.stderr)


if __name__ == "__main__":
    PROGRAM, LAB_PROGRAM, CHROMIUM = sys.argv[1:4]
    if CHROMIUM.endswith("-NOTFOUND"):
        print("skipped: Chromium is missing; apt install chromium")
        sys.exit(77)
    if "/snap/" in str(pathlib.Path(CHROMIUM).resolve()):
        print("skipped: a Chromium from a snap cannot be driven from outside")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1] + sys.argv[4:])
