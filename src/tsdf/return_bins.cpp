// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
