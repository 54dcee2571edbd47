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


if __name__ == "__main__":
    PROGRAM, LAB_PROGRAM, CHROMIUM = sys.argv[1:4]
    if CHROMIUM.endswith("-NOTFOUND"):
        print("skipped: Chromium is missing; apt install chromium")
        sys.exit(77)
    if "/snap/" in str(pathlib.Path(CHROMIUM).resolve()):
        print("skipped: a Chromium from a snap cannot be driven from outside")
        sys.exit(77)
    unittest.main(argv=sys.argv[:1] + sys.argv[4:])
